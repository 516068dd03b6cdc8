# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write the results of find_missing_effect.

These are finding.json for programs and report.html for people, each with its provenance.
"""

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from rover_parameters.parameters import effective
from terrain_estimator.files.atomic import write_file
from terrain_estimator.offline.bag_options import BagOptions
from terrain_estimator.offline.provenance import bag_sha256, versions
from terrain_estimator.offline.reference_drives import as_text
from terrain_estimator.offline.run_soils import RunSoils
from terrain_estimator.pages.finding import finding_page
from terrain_estimator.topics import INPUT_TYPES
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

FINDING = ("finding.json", "report.html")
"""Names of the files of a finding."""


def known(value: Any) -> Any:  # noqa: ANN401 (whatever JSON holds)
    """Replace numbers that are not finite by None.

    One missing figure must not cost all others.
    """
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: known(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [known(each) for each in value]
    return value


def write_finding(
    folder: Path,
    content: Mapping[str, Any],
    page: Callable[[Mapping[str, Any]], str] = finding_page,
) -> None:
    """Write finding.json and report.html to ``folder``; raises OutputError.

    ``page`` makes the text of the report. The same content gives the same bytes.
    """
    texts = {
        FINDING[0]: json.dumps(known(content), indent=1, allow_nan=False) + "\n",
        FINDING[1]: page(content),
    }
    for name, text in texts.items():
        write_file(folder / name, text)


def asked(rover: str, soils: RunSoils, seed: int, reading: BagOptions) -> dict[str, Any]:
    """Return the arguments that the answer depends on, apart from the runs.

    ``soils`` by the path of the run are there only where they differ.
    """
    usual = BagOptions()
    topics = {
        name: reading.names[name]
        for name in INPUT_TYPES
        if reading.names[name] != usual.names[name]
    }
    before = effective(usual.config)
    parameters = {
        name: value for name, value in effective(reading.config).items() if value != before[name]
    }
    told: dict[str, Any] = {"rover": rover, "soil": soils.words(), "seed": seed}
    told["other_soils"] = list(soils.others)
    if len(set(soils.names.values())) > 1:
        told["soils"] = {str(run): name for run, name in soils.names.items()}
    return told | {"topics": topics, "parameters": parameters}


def provenance(rover: Rover, soils: RunSoils) -> dict[str, Any]:
    """Return versions, and SHA-256 of all inputs; ``soils`` of all runs."""
    thresholds = (files("terrain_estimator.discovery.evidence") / "thresholds.json").read_bytes()
    return {
        "versions": versions(),
        "sha256": {
            "rover": _of_record(rover),
            **soil_sums(soils),
            "thresholds": hashlib.sha256(thresholds).hexdigest(),
        },
        "runs_sha256": [[bag.name, bag_sha256(bag)] for bag in soils.soils],
    }


def soil_sums(soils: RunSoils) -> dict[str, str]:
    """Return the SHA-256 of a single soil as told, or of each one by its name, and of others."""
    sums = {name: _of_record(soils.soils[run]) for run, name in soils.names.items()}
    told = set(soils.soils.values())
    others = {
        f"other soil {soil.name}": _of_record(soil) for soil in soils.at_hand if soil not in told
    }
    if len(sums) == 1:
        return {"soil": next(iter(sums.values()))} | others
    return {f"soil {name}": value for name, value in sums.items()} | others


def _of_record(record: Rover | Soil) -> str:
    """Return the SHA-256 of the values in force, not of the text of their file."""
    return hashlib.sha256(as_text(record).encode()).hexdigest()
