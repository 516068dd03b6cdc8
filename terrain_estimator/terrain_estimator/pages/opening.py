# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The first sentence of a finding: what it is, how much it matters, and what adding it gains."""

import math
import re
from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from terrain_estimator.pages.number_format import interval, words

TITLES = {
    "slope_bias": "A tilted attitude sensor",
    "bulldozing": "Soil pushed ahead of the wheel",
    "drive_drag": "Viscous drag in the drives",
    "coulomb_drag": "Dry friction in the drives",
    "payload": "More mass than the rover file says",
    "grousers": "Lugs",
    "slip_sinkage": "A wheel that digs as it slips",
    "multipass": "Wheels in the ruts of others",
    "odometry_scale": "A wrong wheel radius",
    "failed_wheel": "An axle that does not drive",
    "sinkage_bias": "A biased sinkage camera",
    "latency": "Late slip and sinkage",
    "rate_dependence": "Soil that depends on speed",
    "exit_angle": "Soil that springs back behind the wheel",
    "contact_law_scm": "Pressure along the normal of the ground, and ruts that stay",
    "lateral_bulldozing": "Soil pushed aside by the wheel",
}
"""Effects as an engineer would call them."""
_CHANGES = (
    ("drawbar_pull", "pulls {} more", "pulls {} less"),
    ("sinkage", "sinks {} deeper", "sinks {} less"),
    ("torque", "takes {} more torque", "takes {} less torque"),
)
_SHOWN = {"m": (1e3, "mm")}
"""Factor and unit in which a quantity is written, where that is not its own."""
_SMALL = 0.2
"""[1] Share of its interval below which a change is not mentioned."""
_LOWERED = 0.9
"""[1] Error after over that before up to which adding an effect helps a row noticeably."""
_AXLE = re.compile(r"_(\d+)$")
"""The axle in the name of a row, 0 at the front."""
UNLIKELY = 0.05
"""[1] Probability over that of the best answer below which a candidate counts as excluded."""


def opening(finding: Mapping[str, Any]) -> Markup:
    """Return the first sentence about what is named; empty where nothing is."""
    effects = finding["effects"]
    if finding["verdict"] not in {"named", "confusable"} or not effects:
        return Markup("")
    together = len(effects) - len(finding["confusable_with"])
    first = effects[: max(together, 1)]
    title = words([TITLES.get(each["name"], each["name"]) for each in first])
    size = _change(first[0]) or Markup("; ").join(
        interval(each["coefficient"], each["sd"], each["unit"]) for each in first
    )
    gained = _gained(finding)
    if finding["verdict"] == "confusable":
        title += " (or what it is confused with)"
    return Markup("{}: {}{}.").format(title, size, gained)


def _change(effect: Mapping[str, Any]) -> Markup:
    """Return what the effect of a wheel changes; empty for drives, which have no such figure."""
    change = effect.get("change")
    if not change:
        return Markup("")
    said = []
    for row, more, less in _CHANGES:
        ends = change["rows"].get(row)
        if ends is None or abs(ends["median"]) < _SMALL * (ends["high"] - ends["low"]):
            continue
        factor, unit = _SHOWN.get(ends["unit"], (1.0, ends["unit"]))
        said.append((more if ends["median"] > 0.0 else less).format(_figures(ends, factor, unit)))
    at = f"at slip {change['slip']:g} and {change['load_n']:.3g} N"
    without = "smooth one" if effect["name"] == "grousers" else "wheel without it"
    if not said:
        return Markup("{} the wheel differs little from a {}").format(at, without)
    return Markup("{} the wheel {} than a {}").format(at, words(said), without)


def _figures(ends: Mapping[str, float], factor: float, unit: str) -> str:
    low, middle, high = (f"{abs(factor * ends[key]):.2g}" for key in ("low", "median", "high"))
    if ends["low"] < 0.0 < ends["high"]:
        return f"{middle} {unit} (of uncertain sign)"
    return f"{middle} {unit} ({min(low, high, key=float)} to {max(low, high, key=float)})"


def _gained(finding: Mapping[str, Any]) -> str:
    """Return how adding it changes the error on what was not fitted."""
    if (finding.get("proof") or {}).get("undecided"):
        return "; the held-out runs hardly show it, so that it is unproven"
    gap = finding.get("gap") or {}
    if gap.get("after") is None:
        return ""
    where = "settings" if "settings" in gap or "described" in gap else "runs"
    errors = [
        (name, each["before"], each["after"], each["unit"])
        for name, each in (gap.get("rows") or {}).items()
        if each["after"] is not None
    ]
    errors += [
        (each["row"], *each["error"], each["unit"])
        for each in (finding.get("proof") or {}).get("rows") or ()
        if each["region"] == "everywhere" and each["error"][1] is not None and each["unit"]
    ]
    if not errors:
        return ""
    usual = [each for each in errors if each[0] in ("drawbar_pull", "velocity")] or errors
    name, before, after, unit = usual[-1]
    if after > _LOWERED * before:  # the effect acts elsewhere: say where it helps most
        helped = min(errors, key=lambda each: each[2] / each[1] if each[1] > 0.0 else math.inf)
        if helped[2] <= _LOWERED * helped[1]:
            name, before, after, unit = helped
    factor, shown = _SHOWN.get(unit, (1.0, unit))
    row, shown = signal_words(name), "" if shown == "1" else f" {shown}"
    change = "takes" if after < before else "does not lower"
    figures = f"from {factor * before:.2g} to {factor * after:.2g}{shown}"
    return f"; adding it {change} the error of the {row} on unseen {where}" + (
        f" {figures}" if after < before else f" ({figures})"
    )


def signal_words(name: str) -> str:
    """Return the name of a signal or row in words, such as slip of axle 0."""
    return _AXLE.sub(r" of axle \1", name).replace("_", " ")


def excluded(probabilities: Mapping[str, float]) -> list[str]:
    """Return a line on every candidate that is much less likely than the best answer."""
    best = max(probabilities, key=probabilities.__getitem__)
    titles = {"none": "nothing missing", "unknown": "an effect that was not considered"}
    found = []
    for name, value in sorted(probabilities.items(), key=lambda pair: -pair[1]):
        if value < UNLIKELY * probabilities[best]:
            ratio = float(f"{probabilities[best] / max(value, 1e-6):.2g}")
            times = f"{ratio:.0f} times" if value > 1e-6 else "over 1e6 times"
            than = titles.get(best, best)
            found.append(f"{titles.get(name, name)}: {times} less likely than {than}")
    return found
