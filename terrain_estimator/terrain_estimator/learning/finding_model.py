# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Model file of a finding: the rover's model with the named effect."""

import math
from pathlib import Path

from rover_parameters.records import ConfigError
from terrain_estimator.discovery.evidence.verdict import Verdict
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.learning.adding import Sized, add_effects, restored
from terrain_estimator.model.model_file import (
    ModelFileError,
    load_model,
    model_names,
    model_path,
    read_metadata,
)
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior
from terramechanics.vehicle.rover import Rover

ELSEWHERE = 0.3
"""[1] Relative deviation of a size from one day to the next, in addition to that of the fit.

No effect keeps exactly to its named law.
"""


def check_model(model: str, rover: Rover) -> None:
    """Check that the model can be extended; raises ModelFileError."""
    known = load_model(model)
    if known.rover != rover:
        raise ModelFileError(
            f"model {model} was made for another rover than {rover.name}: give its rover by"
            " --rover, or another --model"
        )
    restored(known)


def prior_of(model: str, rover: Rover) -> Prior:
    """Return the prior of a model, else of the installed one of the rover's name, else the default.

    Raises ModelFileError.
    """
    if not model and rover.name not in model_names():
        return DEFAULT_PRIOR
    return read_metadata(model_path(model or rover.name).with_suffix(".json")).prior


def write_model(finding: Finding, rover: Rover, model: str, path: Path, new: Path) -> Path | str:
    """Write the model with the named effect, the size found as its prior, to ``new``.

    Return its later place ``path``, or the reason why none is written. ``model`` is the name or
    file of the model to extend; empty: the model with the rover's name.
    """
    if model and Path(model).resolve() == path.resolve():
        return f"no model is written: {path} is the model to extend; give another --out"
    if finding.judgement.verdict is not Verdict.NAMED:
        return "no model is written: no effect is named"
    try:
        known = load_model(model or rover.name)
        if known.rover != rover:
            return (
                f"no model is written: {known.model_id} is for another rover than {rover.name};"
                " give --model"
            )
        candidate = finding.candidate(finding.judgement.named[0])
        sizes = [
            Sized(name, size, math.hypot(sd, ELSEWHERE * size))
            for name, size, sd in candidate.sizes
        ]
        add_effects(known, sizes, new)
    except (ConfigError, ModelFileError) as error:
        return f"no model is written: {error}"
    return path
