# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil files of the constants that a search found, and their part of finding.json."""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from terrain_estimator.discovery.evidence.soil_revision import RevisedStudy, Revision
from terrain_estimator.discovery.proof.soil_proof import Proven

SOILS = "soils"
"""Folder of the soil files beside finding.json."""


def soils_content(outcome: Proven) -> list[dict[str, Any]]:
    """Return the constants of every revised soil: as told, found, standard deviation.

    There is no file of constants that held-out runs refute, or of a soil whose own file fits, and
    none is written where that of another soil, ``fits``, does.
    """
    soil = outcome.finding.soil
    return _content(soil, written=not outcome.soil_refuted) if soil else []


def refuted_content(outcome: Proven) -> list[dict[str, Any]]:
    """Return the same of soils that held-out runs refute, where the answer is on those as told."""
    return _content(outcome.refuted, written=False) if outcome.refuted else []


def _content(soil: RevisedStudy, *, written: bool) -> list[dict[str, Any]]:
    revisions = soil.revisions
    return [
        {
            "soil": each.told.name,
            "runs": each.runs,
            "file": f"{SOILS}/{name}.yaml" if each.is_new and written else None,
            "fits": each.found.name if each.of_file else None,
            "moved": list(each.moved),
            "constants": {
                name: {
                    "told": getattr(each.told, name),
                    "found": getattr(each.found, name),
                    "sd": sd,
                }
                for name, sd in each.sd.items()
            },
        }
        for each, name in zip(revisions, _names(revisions), strict=True)
    ]


def write_soils(outcome: Proven, folder: Path) -> list[str]:
    """Write a soil file for every revised soil to ``folder``/SOILS; return their places in it.

    None is written of constants that held-out runs refute, or of a soil whose own file or that of
    another soil fits.
    """
    if outcome.finding.soil is None or outcome.soil_refuted:
        return []
    places, revisions = [], outcome.finding.soil.revisions
    for each, name in zip(revisions, _names(revisions), strict=True):
        if not each.is_new:
            continue
        (folder / SOILS).mkdir(exist_ok=True)
        places.append(f"{SOILS}/{name}.yaml")
        told = re.sub(r"\s+", " ", each.told.name)
        head = (
            f"# Constants that {each.runs} runs have in common, by find_missing_effect; those of"
            f" {told} do not fit.\n"
        )
        content = dataclasses.asdict(each.found) | {"name": name}
        text = yaml.safe_dump(content, sort_keys=False)
        (folder / places[-1]).write_text(head + text, encoding="utf-8")
    return places


def _names(revisions: Sequence[Revision]) -> list[str]:
    """Return a name for each soil that is a file's name, and no other's: files may share a name."""
    names: list[str] = []
    for each in revisions:
        name = re.sub(r"[^\w.-]+", "_", each.found.name).lstrip("._-")
        same = sum(re.fullmatch(rf"{re.escape(name)}(_\d+)?", other) is not None for other in names)
        names.append(f"{name}_{same + 1}" if same else name)
    return names
