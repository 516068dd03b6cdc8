# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Mapping of a bag's topics to the inputs of the estimator."""

from collections.abc import Iterable, Mapping

from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES, REQUIRED_INPUTS

KNOWN = (*INPUT_TYPES, *OUTPUT_TYPES, "ground_truth/terrain")


class TopicError(ValueError):
    """Topics of a bag cannot be matched with the estimator's."""


def absolute(name: str, namespace: str = "") -> str:
    """Return the topic's full name."""
    if name.startswith("/"):
        return name
    prefix = namespace.strip("/")
    return f"/{prefix}/{name}" if prefix else f"/{name}"


def parse_remap(rule: str) -> tuple[str, str]:
    """Split ``from:=to`` into (topic of the estimator, topic in the bag).

    Both orders are in use: nodes accept ``wheel_slip:=/rover1/slip``, ``ros2 bag play`` accepts
    ``/rover1/slip:=wheel_slip``. One side must be a topic of the estimator, which distinguishes
    them; where both are, the node's order applies.

    Raises:
        TopicError: the rule has another form, or no side is known.
    """
    first, separator, second = rule.partition(":=")
    if not (first and separator and second):
        raise TopicError(f"remap {rule!r}: expected from:=to")
    for ours, theirs in ((first, second), (second, first)):
        if ours.lstrip("/") in KNOWN:
            return ours.lstrip("/"), theirs
    raise TopicError(
        f"remap {rule!r}: neither side is a topic of the estimator ({', '.join(KNOWN)})"
    )


def bag_topics(remap: Iterable[str], namespace: str) -> dict[str, str]:
    """Return the names in the bag of all topics that the estimator uses.

    Raises:
        TopicError: a rule is invalid, or two topics would have one name.
    """
    rules = dict(parse_remap(rule) for rule in remap)
    names = {name: absolute(rules.get(name, name), namespace) for name in KNOWN}
    read_as = {topic: name for name, topic in names.items()}
    for name, topic in names.items():
        if read_as[topic] != name:
            raise TopicError(
                f"{topic} would be both {name} and {read_as[topic]}: remap each to a topic of"
                " its own"
            )
    return names


def check_inputs(bag: str, present: Mapping[str, object], names: Mapping[str, str]) -> None:
    """Check that the required topics are present.

    A TopicError names the missing ones, and similar ones in the bag.
    """
    missing = [names[name] for name in REQUIRED_INPUTS if names[name] not in present]
    if not missing:
        return
    similar = [
        topic
        for topic in sorted(present)
        if topic.rsplit("/", 1)[-1] in REQUIRED_INPUTS and topic not in names.values()
    ]
    hint = (
        f"it has {', '.join(similar)}: give --namespace or --remap"
        if similar
        else f"it has {', '.join(sorted(present)) or 'no topics'}"
    )
    if missing == [names["wheel_slip"]] and names["joint_states"] in present:
        hint += (
            "; or create it from the wheel rates and a velocity with add_slip"
            " (docs/bring_your_own_rover.md)"
        )
    raise TopicError(f"{bag}: no topic {', '.join(missing)}; {hint}")


def perhaps_renamed(bag: str, present: Mapping[str, str], names: Mapping[str, str]) -> list[str]:
    """Return a note for each optional input without its topic, where another may be it.

    ``present`` are the types of the bag's topics by their names.
    """
    used = set(names.values())
    notes = []
    for name, type_name in INPUT_TYPES.items():
        if name in REQUIRED_INPUTS or names[name] in present:
            continue
        others = sorted(
            topic for topic, found in present.items() if found == type_name and topic not in used
        )
        if others:
            notes.append(
                f"{bag}: no topic {names[name]}, whose rows are missing; of its type there is"
                f" {', '.join(others)}: if that is meant, give --remap {name}:={others[0]}"
            )
    return notes
