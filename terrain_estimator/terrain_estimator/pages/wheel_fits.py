# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Both fits of the contact law to tables of one wheel, in words."""

from collections.abc import Mapping
from typing import Any

_SHOWN = {"m": (1e3, "mm"), "Pa": (1e-3, "kPa")}
"""Factor and unit in which a quantity is written, where that is not its own."""


def fit_sentences(fits: Mapping[str, Any]) -> list[str]:
    """Return what both fits say, a line each (``fits`` of finding.json)."""
    return [_free(fits), *_as_measured(fits)]


def _free(fits: Mapping[str, Any]) -> str:
    free = fits["constants_free"]
    errors = ", ".join(
        f"{row.replace('_', ' ')} {_with_unit(each['rms'], each['unit'])}"
        for row, each in free["rows"].items()
    )
    law = " with ".join(["the contact law", *filter(None, [" and ".join(fits["effects"])])])
    return (
        f"Constants free: {law} fits with root mean square errors of {errors}"
        f" ({free['unknowns']} free numbers, {free['measurements']} values; this says nothing about"
        " c and tan phi)."
    )


def _as_measured(fits: Mapping[str, Any]) -> list[str]:
    found, box = fits["constants_as_measured"], fits["shear_box"]
    if found is None:
        return [f"Constants as measured: {fits['why']}."]
    strengths = [
        f"{name} {_interval(found[key], unit)}{_beside(box, key, unit)}"
        for name, key, unit in (("c", "cohesion_pa", "Pa"), ("tan phi", "tan_phi", "1"))
    ]
    errors = ", ".join(
        f"{row.replace('_', ' ')} {_with_unit(each['median'], each['unit'])}"
        for row, each in found["model_error"].items()
    )
    first = (
        f"Constants as measured, with a model error of {errors}: {', '.join(strengths)}. These 95 %"
        " intervals include the model error."
    )
    said = [first]
    for each in found["rejected"]:
        measured, sd = (_with_unit(each[key], each["unit"]) for key in ("measured", "measured_sd"))
        said.append(
            f"The tables contradict the measured {each['name']}: {measured} +- {sd} was measured,"
            f" {_interval(each['fitted'], each['unit'])} fits, {each['deviations']:.1f} deviations"
            " apart."
        )
    if found["rejected"]:
        said.append("With a contradicted constant do not rely on c and tan phi.")
    return said


def _interval(ends: Mapping[str, float], unit: str) -> str:
    factor, shown = _SHOWN.get(unit, (1.0, unit))
    low, middle, high = (f"{factor * ends[key]:.3g}" for key in ("low", "median", "high"))
    return f"{middle}{_unit(shown)} ({low} to {high})"


def _beside(box: Mapping[str, Any] | None, key: str, unit: str) -> str:
    if box is None:
        return ""
    value, sd = (_with_unit(box[key][each], unit) for each in ("value", "sd"))
    return f", shear box {value} +- {sd}"


def _with_unit(value: float, unit: str) -> str:
    factor, shown = _SHOWN.get(unit, (1.0, unit))
    return f"{factor * value:.3g}{_unit(shown)}"


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"
