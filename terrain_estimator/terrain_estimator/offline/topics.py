# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Which topic of a bag is which input of the estimator."""

from collections.abc import Iterable, Mapping

from terrain_estimator.ros_types import INPUT_TYPES, OUTPUT_TYPES, REQUIRED_INPUTS

KNOWN = (*INPUT_TYPES, *OUTPUT_TYPES, "ground_truth/terrain")


class TopicError(ValueError):
    """Topics of a bag cannot be matched with the estimator's."""


def absolute(name: str, namespace: str = "") -> str:
    """The topic's full name."""
    if name.startswith("/"):
        return name
    prefix = namespace.strip("/")
    return f"/{prefix}/{name}" if prefix else f"/{name}"


def parse_remap(rule: str) -> tuple[str, str]:
    """(our topic, topic in the bag) of ``from:=to``.

    Both orders are in use: nodes take ``wheel_slip:=/rover1/slip``, ``ros2 bag play`` takes
    ``/rover1/slip:=wheel_slip``. One side has to be a topic that the estimator knows, which tells
    them apart; where both are, the node's order holds.

    Raises:
        TopicError: another form, or no side is known.
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
    """Names in the bag of all topics that the estimator knows.

    Raises:
        TopicError: a rule is none, or two topics would have one name.
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
    """Raises TopicError that names what is missing, and what in the bag looks like it."""
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
            "; or make it of the wheel rates and a velocity by add_slip"
            " (docs/bring_your_own_rover.md)"
        )
    raise TopicError(f"{bag}: no topic {', '.join(missing)}; {hint}")
