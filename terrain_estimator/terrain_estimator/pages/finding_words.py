# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Words of a report about a finding, which can be read without any other page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from terrain_estimator.pages.number_format import chance, interval, probability, words
from terrain_estimator.pages.opening import opening
from terramechanics.effects import EFFECTS


@dataclass(frozen=True, slots=True)
class Headline:
    """Answer at the top of the page."""

    name: str
    sign: str
    headline: str
    sentence: Markup


_SIGNS = {"none": "✓", "soil": "●", "named": "●", "confusable": "≈", "unknown": "?"}


def verdict(finding: Mapping[str, Any]) -> Headline:
    """Return the verdict; KeyError for an unknown one."""
    name = finding["verdict"]
    headline, sentence = {
        "none": _none,
        "soil": _soil,
        "named": _named,
        "confusable": _confusable,
        "unknown": _unknown,
    }[name](finding)
    if leader := doubt(name, finding["probabilities"]):
        before, likely = _DOUBTS[leader]
        headline = before + headline.removeprefix("The model lacks ")
        most = Markup("The most probable answer is that {} ({}). ")
        sentence = most.format(likely, probability(finding["probabilities"][leader])) + sentence
    if exact := exact_words(finding.get("exact_constants") or ()):
        sentence += Markup(" {}.").format(_capital(exact))
    for each in finding.get("rover_constants") or ():
        if each["notable"]:
            sentence += Markup(" {}.").format(
                _capital(constant_words(each).removeprefix("rover: "))
            )
    if usual := tolerance_words(finding.get("rover_tolerance") or {}):
        sentence += Markup(" {}.").format(_capital(usual))
    first = opening(finding)
    if first:
        sentence = first + Markup(" ") + sentence
    if name != "soil" and (soils := finding.get("soils") or finding.get("refuted_soils")):
        before = (
            "Another soil fits the searched runs, and did not hold on held-out runs"
            if soil_refuted(finding)
            else "The soil file does not fit, either"
        )
        found = "; ".join(map(soil_words, soils)).replace("+-", "±")
        sentence += Markup(" {}: {}.").format(before, found)
    return Headline(name, _SIGNS[name], headline, sentence)


_DOUBTS = {
    "none": ("It is uncertain whether the model lacks ", "nothing is missing"),
    "unknown": ("Something is missing, perhaps ", "an effect that was not considered is missing"),
}
"""Beginning of the headline, and the most probable answer, where that names no effect."""


_LIKELY, _POSSIBLE = 0.5, 0.05
"""[1] Probabilities below which nothing missing is in doubt, and an answer is not listed."""


def doubt(verdict: str, probabilities: Mapping[str, float]) -> str:
    """Return the answer that is more probable than every effect which a verdict names.

    That is "none" or "unknown"; empty where an effect leads, or none is named.
    """
    leader = max(probabilities, key=probabilities.__getitem__)
    return leader if verdict in {"named", "confusable"} and leader in _DOUBTS else ""


def doubt_note(verdict: str, probabilities: Mapping[str, float]) -> str:
    """Return :func:`doubt` as an addition to a line of text."""
    leader = doubt(verdict, probabilities)
    return f" (most probable: {leader}, {probabilities[leader]:.0%})" if leader else ""


def what_it_is(name: str) -> str:
    """Describe the physics of a candidate; several effects get one sentence each."""
    special = {
        "none": "Nothing is missing.",
        "soil": "The soil is another than its file says, and nothing else is missing.",
        "unknown": "Something is missing that is not among the considered effects.",
    }
    return special.get(name) or " ".join(
        EFFECTS[part].sentence for part in name.split(" + ") if part in EFFECTS
    )


def _none(finding: Mapping[str, Any]) -> tuple[str, Markup]:
    chances = finding["probabilities"]
    sure = probability(chances["none"])
    if chances["none"] < _LIKELY:
        others = sorted(
            (name for name in chances if name != "none"), key=lambda name: -chances[name]
        )
        listed = Markup("; ").join(
            Markup("{} {}").format(name, probability(chances[name]))
            for name in others
            if chances[name] >= _POSSIBLE
        )
        return "No effect identified", Markup(
            "The most probable answer is that nothing is missing ({}). That is not certain. Also"
            " possible: {}."
        ).format(sure, listed)
    sentence = Markup(
        "No effect explains the measurements better than the model without one, and neither does a"
        " discrepancy without a name (probability that nothing is missing: {}). An effect that is"
        " too small to show here is not excluded."
    )
    return "No missing effect found", sentence.format(sure)


def _soil(finding: Mapping[str, Any]) -> tuple[str, Markup]:
    soils = finding["soils"]
    found = "; ".join(map(soil_words, soils)).replace("+-", "±")
    sure = probability(finding["probabilities"]["soil"])
    ground = ground_words(soils, len(finding["runs"]))
    if ground:
        text = Markup(
            "{}. There nothing else is missing (probability {}). Give this soil by --soil, and take"
            " a model that has it."
        )
        return _capital(ground), text.format(_capital(found), sure)
    text = Markup(
        "With these constants nothing else is missing (probability {}): {}. Measure the soil again,"
        " or use the soil file written beside this page."
    )
    return "The soil differs from its file", text.format(sure, found)


def ground_words(soils: Sequence[Mapping[str, Any]], runs: int) -> str:
    """Return in words on which soils of other files ``runs`` runs are; empty for no such soils."""
    if not all(each.get("fits") for each in soils):
        return ""
    names = list(dict.fromkeys(each["fits"] for each in soils))
    if len(names) == 1 and sum(each["runs"] for each in soils) == runs:
        return f"the ground is {names[0]}"
    return words([f"runs told to be on {each['soil']} are on {each['fits']}" for each in soils])


def sentence(text: str) -> str:
    """Return ``text`` with a capital letter and a full stop; empty for an empty one."""
    return f"{_capital(text)}." if text else ""


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def soil_words(revision: Mapping[str, Any]) -> str:
    """Return in one line which soil fits, or the constants of a revised one that moved."""
    runs = "1 run" if revision["runs"] == 1 else f"{revision['runs']} runs"
    if revision.get("fits"):
        return f"soil {revision['soil']} ({runs}): the file of {revision['fits']} fits better"
    moved = [
        f"{name} {each['found']:.3g} +- {each['sd']:.1g} instead of {each['told']:.3g}"
        for name, each in revision["constants"].items()
        if name in revision["moved"]
    ]
    return f"soil {revision['soil']} ({runs}): {', '.join(moved) or 'its file fits'}"


_CONSTANTS = {
    "mass": "mass",
    "wheel_radius": "wheel radius",
    "wheel_width": "wheel width",
    "centre_of_mass_x": "centre of mass along the body",
    "centre_of_mass_height": "height of the centre of mass",
}


def constant_words(constant: Mapping[str, Any]) -> str:
    """Return in one line how far the runs move a constant of the rover from its file."""
    name, unit, moved = _CONSTANTS[constant["name"]], constant["unit"], constant["moved"]
    by = abs(constant["found"] - constant["told"])
    if constant["notable"]:
        side, cause = "low" if moved > 0.0 else "high", ""
        if constant["effect"]:
            cause = f", or {constant['effect']}{'' if constant['named'] else ' is missing'}"
        return (
            f"rover: the file's {name} is {by:.2g} {unit} too {side}, {abs(moved):.1f} of its"
            f" stated deviations{cause}"
        )
    return (
        f"rover: {name} {constant['found']:.4g} +- {constant['found_sd']:.2g} {unit}, told"
        f" {constant['told']:.4g} +- {constant['told_sd']:.2g}: moved by {moved:+.1f} stated"
        " deviations"
    )


def exact_words(constants: Sequence[str]) -> str:
    """Return in one line that these ``constants`` of the rover count as exact; empty for none."""
    if not constants:
        return ""
    names = words([_CONSTANTS[each] for each in constants])
    stated = ",".join(f"{each}=SD" for each in constants)
    return (
        f"the rover file's {names} may be wrong instead, and counts as exact here: measure it"
        f" again, or say how well it is known by --rover-sd {stated} (models by axle)"
    )


def tolerance_words(tolerance: Mapping[str, Any]) -> str:
    """Return in one line what was found on an exact rover file; empty where that is the answer."""
    if not tolerance:
        return ""
    named = words(tolerance["named"])
    if tolerance["verdict"] == "unknown":
        named = f"unknown (closest: {named})" if named else "unknown"
    taken = ",".join(f"{name}={sd:.2g}" for name, sd in tolerance["rover_sd"].items())
    return (
        f"with an exact rover file the answer is {named}; files are usually off by as much, so"
        f" this answer takes --rover-sd {taken}: state yours, or --rover-sd exact"
    )


def soil_refuted(finding: Mapping[str, Any]) -> bool:
    """Return whether held-out runs contradict the revised constants."""
    return (finding.get("soil_proof") or {}).get("holds") is False


def _named(finding: Mapping[str, Any]) -> tuple[str, Markup]:
    effects = finding["effects"]
    sizes = Markup("")
    if "change" in effects[0]:  # else the opening has the sizes
        which = "Its size" if len(effects) == 1 else "Their sizes"
        sizes = Markup(" {}: {}.").format(which, Markup("; ").join(map(_size, effects)))
    sentence = Markup("{}{} Probability {}.").format(
        " ".join(what_it_is(each["name"]) for each in effects),
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


def unseen_words(error: float, floor: float) -> str:
    """Return the verdict in words where only rollouts, missing by ``error``, show that it fails."""
    return (
        "unknown: something is missing that no row of the fit shows; rollouts of held-out runs miss"
        f" by {error:.2f} sd of the sensors, {error / floor:.1f} times the noise floor"
    )


def not_tried_words(names: Sequence[str]) -> str:
    """Return in one line how to try effects that were no candidates; empty for none."""
    told = (f"--library {name} tries one more: {EFFECTS[name].sentence}" for name in names)
    return " ".join(told)


def _unknown(finding: Mapping[str, Any]) -> tuple[str, Markup]:
    if not finding["effects"] and (gap := finding.get("gap") or {}).get("before"):
        said = unseen_words(gap["before"], gap["noise_floor"]).removeprefix("unknown: ")
        return "Something is missing that no row shows", Markup("{}{}.").format(
            said[0].upper(), said[1:]
        )
    sure, closest = (
        probability(finding["probabilities"]["unknown"]),
        words([each["name"] for each in finding["effects"]]),
    )
    sentence = Markup(
        "Something is missing, and none of the considered effects explains it (probability {})."
    ).format(sure)
    if (finding.get("proof") or {}).get("effect"):
        sentence += Markup(
            " {} fitted the searched runs, but did not prove itself on the held-out runs."
        ).format(closest)
    elif closest:
        sentence += Markup(" The closest is {}.").format(closest)
    for each in (finding.get("left") or ())[:1]:
        sentence += Markup(" What remains depends most on {} in the {} row.").format(
            each["signal"], each["row"]
        )
    if more := not_tried_words(finding.get("not_tried") or ()):
        sentence += Markup(" {}").format(more)
    return "Something is missing that no considered effect explains", sentence


def alternatives(finding: Mapping[str, Any]) -> list[list[Mapping[str, Any]]]:
    """Return the effects of each hypothesis that remains; several in one act together."""
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
    """Describe a disagreement between a row and the model."""
    if entry.get("sentence"):
        return sentence(entry["sentence"])
    region = f", {entry['region']}" if entry["region"] else ""
    return (
        f"{entry['row']} row, {entry['signal']}{region}: {entry['strength']:.2g} {entry['unit']} (p"
        f" {chance(entry['p']).striptags()})."
    )


def proof_sentence(gap: Mapping[str, Any], proof: Mapping[str, Any]) -> Markup:
    """Describe the result on the held-out runs; empty where there is none."""
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
    """Return the sentences of ``separate_by``."""
    return [f"{part[0].upper()}{part[1:]}." for part in text.split(". ") if part]
