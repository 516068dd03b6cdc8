# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled core against TorchScript where its paths are others than in the recorded drive.

That is ground that drifts, a user's prior, and a model with a named effect.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from terrain_estimator.compiled.core import CompiledModel
from terrain_estimator.compiled.finding import MOST_DIFFERENCE
from terrain_estimator.compiled.folder import build_core, write_core
from terrain_estimator.compiled.runtime import CompiledRuntime
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.adding import Sized, add_effects
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.update import Estimate, Update
from tests.terrain_estimator.compiled.built_cores import needs_core
from tests.terrain_estimator.compiled.test_core import hostile, observed_drive, with_core

pytestmark = needs_core
DRIFTING = CoreConfig(forgetting_time=15.0)
KNOWN = CoreConfig(
    prior_cohesion_mean_pa=1200.0,
    prior_cohesion_sd_pa=400.0,
    prior_tan_phi_mean=0.55,
    prior_tan_phi_sd=0.08,
    prior_soil="loose_sand",
)
CONFIGURATIONS = {
    "drift": DRIFTING,
    "prior": KNOWN,
    "prior of c alone": CoreConfig(prior_cohesion_mean_pa=1200.0, prior_cohesion_sd_pa=400.0),
    "drift and prior": dataclasses.replace(KNOWN, forgetting_time=15.0),
    "fewer rows": CoreConfig(use_sinkage=False, forgetting_time=15.0),
}


def apart(a: Estimate, b: Estimate) -> float:
    """Return the largest difference of two posteriors, in deviations of the second."""
    sd = np.sqrt(np.diagonal(b.covariance))
    means = [(a.mean - b.mean) / sd]
    wider = [(a.covariance - b.covariance) / np.outer(sd, sd)]
    for one, other in zip(a.effects, b.effects, strict=True):
        means.append(np.array([(one.mean - other.mean) / other.sd]))
        wider.append(np.array([one.sd / other.sd - 1.0]))
    return max(float(np.abs(each).max()) for each in (*means, *wider))


def compared(
    plain: LoadedModel, compiled: LoadedModel, config: CoreConfig
) -> tuple[float, list[Update]]:
    """Return the largest difference over a drive with faults, and TorchScript's answers."""
    one, other = Estimator(compiled, config), Estimator(plain, config)
    worst, answers = 0.0, []
    for observation in hostile(observed_drive(60.0)):
        a, b = one.update(observation), other.update(observation)
        assert a.decision.outcome == b.decision.outcome
        assert a.decision.rows_used == b.decision.rows_used
        worst = max(worst, apart(a.estimate, b.estimate))
        assert math.isclose(a.prediction.velocity, b.prediction.velocity, abs_tol=1e-11) or (
            math.isnan(a.prediction.velocity) and math.isnan(b.prediction.velocity)
        )
        answers.append(b)
    return worst, answers


def test_the_compared_answers_are_told_apart_by_a_billionth() -> None:
    model = load_model("mars_rover")
    estimator = Estimator(model, CoreConfig())
    estimate = estimator.update(observed_drive(60.0)[0]).estimate
    sd = np.sqrt(np.diagonal(estimate.covariance))
    other = estimate._replace(mean=estimate.mean + 2.0 * MOST_DIFFERENCE * sd)
    assert apart(estimate, other) > MOST_DIFFERENCE
    assert apart(estimate, estimate) == 0.0


@pytest.fixture(scope="module")
def ordinary() -> Estimate:
    """Return the last estimate of that drive without any of the configurations."""
    plain = load_model("mars_rover")
    return compared(plain, plain, CoreConfig())[1][-1].estimate


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_a_core_gives_torchscripts_posterior_with_drift_and_with_a_users_prior(
    name: str, ordinary: Estimate
) -> None:
    plain = load_model("mars_rover")
    worst, answers = compared(plain, with_core(plain, "mars_rover"), CONFIGURATIONS[name])
    assert worst <= MOST_DIFFERENCE
    assert apart(answers[-1].estimate, ordinary) > 0.01, "the configuration acts"


def test_a_core_with_a_named_effect_gives_torchscripts_posterior_and_size(tmp_path: Path) -> None:
    """Also with drift, of a model as add_effect writes it."""
    path, folder = tmp_path / "dragging.pt", tmp_path / "core"
    add_effects(load_model("mars_rover"), [Sized.of_library("drive_drag")], path)
    write_core(path, folder)
    build_core(folder, tmp_path / "dragging.so", "-O0")
    plain = load_model(str(path))
    core = CompiledModel(tmp_path / "dragging.so")
    assert core.identity == plain.sha256
    assert core.difference() <= MOST_DIFFERENCE
    compiled = dataclasses.replace(plain, runtime=CompiledRuntime(core))
    for config in (CoreConfig(), dataclasses.replace(KNOWN, forgetting_time=15.0)):
        worst, answers = compared(plain, compiled, config)
        assert worst <= MOST_DIFFERENCE
        [first], [last] = answers[0].estimate.effects, answers[-1].estimate.effects
        assert last.sd < 0.9 * first.sd, "the drive tells the effect's size"


def test_a_core_lets_a_named_effect_change_the_coefficients_of_the_contact(
    tmp_path: Path,
) -> None:
    """Grousers do. A recursion may differ by ten times as much as one block, as in test_core."""
    path, folder = tmp_path / "lugs.pt", tmp_path / "core"
    add_effects(load_model("mars_rover"), [Sized.of_library("grousers")], path)
    write_core(path, folder)
    build_core(folder, tmp_path / "lugs.so", "-O0")
    plain, core = load_model(str(path)), CompiledModel(tmp_path / "lugs.so")
    assert core.difference() <= MOST_DIFFERENCE
    compiled = dataclasses.replace(plain, runtime=CompiledRuntime(core))
    worst, answers = compared(plain, compiled, CoreConfig())
    assert worst <= 10.0 * MOST_DIFFERENCE
    [first], [last] = answers[0].estimate.effects, answers[-1].estimate.effects
    assert last.sd < 0.9 * first.sd, "the drive tells the effect's size"
