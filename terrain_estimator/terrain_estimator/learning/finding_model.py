# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Model file of a finding: the rover's model with the named effect."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rover_parameters.records import ConfigError
from terrain_estimator.discovery.evidence.other_soils import alike
from terrain_estimator.discovery.evidence.soil_revision import RevisedStudy
from terrain_estimator.discovery.evidence.verdict import Verdict
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.learning.adding import Sized, add_effects, restored
from terrain_estimator.model.effects import laws_apart
from terrain_estimator.model.metadata import (
    Metadata,
    ModelFileError,
    model_names,
    model_path,
    read_metadata,
)
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces

ELSEWHERE = 0.3
"""[1] Relative deviation of a size from one day to the next, in addition to that of the fit.

No effect keeps exactly to its named law.
"""
BY_ANOTHER_LAW = 1.0
"""[1] The same where the model has another law.

Cohesion up to doubles the thrust of lugs, and changes the resistance of a wedge as much.
"""


def check_model(model: str, rover: Rover) -> None:
    """Check that the model can be extended; raises ModelFileError."""
    known = load_model(model)
    if known.rover.first_difference(rover):
        raise ModelFileError(
            f"model {model} was made for another rover than {rover.name}: give its rover by"
            " --rover, or another --model"
        )
    known.metadata.refuse_velocity_alone(
        "the search compares all rows: give the model of all rows, made without --rows"
    )
    if known.metadata.wheel_places is None:
        restored(known)


def installed_model(rover: Rover) -> str:
    """Return the name of the installed model of a rover, that of its own name where several are.

    Only the names of rover and wheels may differ. Empty where there is none. Raises ModelFileError.
    """
    fitting = [name for name in model_names() if not _metadata(name).rover.first_difference(rover)]
    return rover.name if rover.name in fitting else "".join(fitting[:1])


def prior_of(model: str) -> Prior:
    """Return the prior of a model of that name or file, the default for an empty name.

    Raises ModelFileError.
    """
    return _metadata(model).prior if model else DEFAULT_PRIOR


def places_of(model: str) -> WheelPlaces | None:
    """Return the places of the wheels of a model by wheel, of that name or file.

    None where it is by axle, and for an empty name. Raises ModelFileError.
    """
    return _metadata(model).wheel_places if model else None


def _metadata(model: str) -> Metadata:
    return read_metadata(model_path(model).with_suffix(".json"))


def write_model(finding: Finding, rover: Rover, model: str, path: Path, new: Path) -> Path | str:
    """Write the model with the named effect, the size found as its prior, to ``new``.

    Return its later place ``path``, or the reason why none is written. ``model`` is the name or
    file of the model to extend, empty where there is none. The new one has the names of ``rover``.
    """
    if model and Path(model).resolve() == path.resolve():
        return f"no model is written: {path} is the model to extend; give another --out"
    if finding.judgement.verdict is not Verdict.NAMED:
        return "no model is written: no effect is named"
    if not model:
        return (
            f"no model is written: none of the installed ones ({', '.join(model_names())}) is for"
            f" rover {rover.name}; train one and give it by --model"
        )
    if finding.soil is not None and not _has_soils(model, finding.soil):
        return (
            "no model is written: the soil constants differ from those of the model; train one by"
            f" --soil for {_file_of(finding.soil)}, then add the effect by add_effect"
        )
    try:
        known = load_model(model)
        known = replace(known, metadata=replace(known.metadata, rover=rover))
        candidate = finding.candidate(finding.judgement.named[0])
        add_effects(known, priors(candidate.sizes, known.metadata.wheel_places), new)
    except (ConfigError, ModelFileError) as error:
        return f"no model is written: {error}"
    return path


def priors(sizes: Sequence[tuple[str, float, float]], places: WheelPlaces | None) -> list[Sized]:
    """Return the priors of effects with these sizes and deviations, of wheels at ``places``."""
    apart = dict.fromkeys(laws_apart(places), BY_ANOTHER_LAW)
    return [
        Sized(name, size, math.hypot(sd, apart.get(name, ELSEWHERE) * size))
        for name, size, sd in sizes
    ]


def _has_soils(model: str, found: RevisedStudy) -> bool:
    """Return whether a model has the soils on which the runs are, whatever their names."""
    known = _metadata(model).soils
    return all(any(alike(each.found, soil) for soil in known) for each in found.revisions)


def _file_of(found: RevisedStudy) -> str:
    """Return in words which soil file holds."""
    if found.of_files:
        return " and ".join(dict.fromkeys(each.found.name for each in found.revisions))
    return "the soil file above"
