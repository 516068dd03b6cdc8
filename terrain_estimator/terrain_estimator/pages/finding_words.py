# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The words of a report about a finding; they can be read without any other page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from terrain_estimator.pages.numbers import chance, interval, probability, words
from terramechanics.effects import EFFECTS


@dataclass(frozen=True, slots=True)
class Headline:
    """The answer on top of the page."""

    name: str
    sign: str
    headline: str
    sentence: Markup


_SIGNS = {"none": "✓", "named": "●", "confusable": "≈", "unknown": "?"}


def verdict(finding: Mapping[str, Any]) -> Headline:
    """The verdict; a name that is none of the four is an error."""
    name = finding["verdict"]
    headline, sentence = {
        "none": _none,
        "named": _named,
        "confusable": _confusable,
        "unknown": _unknown,
    }[name](finding)
    return Headline(name, _SIGNS[name], headline, sentence)


def what_it_is(name: str) -> str:
    """The physics of a candidate in a sentence; of several together one after the other."""
    special = {
        "none": "Nothing is missing.",
        "unknown": "Something is missing that is not among the considered effects.",
    }
    return special.get(name) or " ".join(
        EFFECTS[part].sentence for part in name.split(" + ") if part in EFFECTS
    )


def _none(finding: Mapping[str, Any]) -> tuple[str, Markup]:
    sure = probability(finding["probabilities"]["none"])
    sentence = Markup(
        "No effect explains the measurements better than the model without one, and neither does a"
        " discrepancy without a name (probability that nothing is missing: {}). An effect that is"
        " too small to show here is not excluded."
    )
    return "No missing effect found", sentence.format(sure)


def _named(finding: Mapping[str, Any]) -> tuple[str, Markup]:
    effects = finding["effects"]
    sizes = Markup("; ").join(_size(each) for each in effects)
    sentence = Markup("{} {}: {}. Probability {}.").format(
        " ".join(what_it_is(each["name"]) for each in effects),
        "Its size" if len(effects) == 1 else "Their sizes",
        sizes,
        probability(effects[0]["probability"]),
    )
    return f"The model lacks {words([each['name'] for each in effects])}", sentence


def _confusable(finding: Mapping[str, Any]) -> tuple[str, Markup]:
    each_way = alternatives(finding)
    listed = Markup("; ").join(
        Markup("{} (probability {})").format(
            Markup(" with ").join(map(_size, effects)), probability(effects[0]["probability"])
        )
        for effects in each_way
    )
    sentence = Markup(
        "Something is missing, but these measurements cannot decide between {} candidates: {}."
    )
    names = [" with ".join(each["name"] for each in effects) for effects in each_way]
    return f"The model lacks {words(names, 'or')}", sentence.format(len(names), listed)


def _unknown(finding: Mapping[str, Any]) -> tuple[str, Markup]:
    sure, closest = (
        probability(finding["probabilities"]["unknown"]),
        words([each["name"] for each in finding["effects"]]),
    )
    sentence = Markup(
        "Something is missing, and none of the considered effects explains it (probability {})."
    ).format(sure)
    if (finding.get("proof") or {}).get("effect"):
        sentence += Markup(
            " {} fitted the searched runs, but did not improve the prediction of the held-out runs."
        ).format(closest)
    elif closest:
        sentence += Markup(" The closest is {}.").format(closest)
    for each in (finding.get("left") or ())[:1]:
        sentence += Markup(" What remains depends most on {} in the {} row.").format(
            each["signal"], each["row"]
        )
    return "Something is missing that no considered effect explains", sentence


def alternatives(finding: Mapping[str, Any]) -> list[list[Mapping[str, Any]]]:
    """The effects of each hypothesis that a finding leaves open; several in one where they act together."""
    rest = list(finding["effects"])
    others = [label.count(" + ") + 1 for label in finding["confusable_with"]]
    return [
        [rest.pop(0) for _ in range(count)] for count in (len(rest) - sum(others), *others) if count
    ]


def _size(effect: Mapping[str, Any]) -> Markup:
    return Markup("{} {}").format(
        effect["name"], interval(effect["coefficient"], effect["sd"], effect["unit"])
    )


def disagreement(entry: Mapping[str, Any]) -> str:
    """Where a row and the model disagree."""
    if entry.get("sentence"):
        return f"{entry['sentence'][0].upper()}{entry['sentence'][1:]}."
    region = f", {entry['region']}" if entry["region"] else ""
    return (
        f"{entry['row']} row, {entry['signal']}{region}: {entry['strength']:.2g} {entry['unit']} (p"
        f" {chance(entry['p']).striptags()})."
    )


def proof_sentence(gap: Mapping[str, Any], proof: Mapping[str, Any]) -> Markup:
    """The result on the held-out runs; empty where there is none."""
    if not proof:
        return Markup("")
    sentence = Markup("Proof: {}.").format(proof["sentence"])
    if gap.get("closed") is not None:
        limits = [_percent(each) for each in gap.get("closed_95") or ()]
        sentence += Markup(" That closes {} of the gap").format(_percent(gap["closed"]))
        sentence += (
            Markup(" (95&nbsp;% interval {} to {}).").format(*limits) if limits else Markup(".")
        )
    return sentence


def _percent(share: float) -> Markup:
    return Markup('<data value="{}">{:.0f}&nbsp;%</data>').format(repr(float(share)), 100.0 * share)


def separation(text: str) -> Sequence[str]:
    """The sentences of ``separate_by``, one by one."""
    return [f"{part[0].upper()}{part[1:]}." for part in text.split(". ") if part]
