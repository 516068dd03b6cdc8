# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The search by wheel, and the model that it writes, on drives with turns of a skid-steer.

One case with a hidden effect and one without, whose seeds were fixed before they were run: they
show that the parts fit together. How often verdicts are right is counted by ``turning_batch``.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from rover_parameters.records import ConfigError
from studies.by_wheel.drives import model_by_wheel
from studies.off_plane import SOIL
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.discovery.evidence.isolability import isolability
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import Verdict, read_thresholds
from terrain_estimator.discovery.hypotheses.library import (
    NOT_BY_WHEEL,
    LibraryEffect,
    singles,
    singles_by_wheel,
)
from terrain_estimator.discovery.hypotheses.rows import Expansion, LinearizationPoint
from terrain_estimator.discovery.hypotheses.wheel_rows import WheelRows
from terrain_estimator.discovery.proof.soil_proof import Proven, proven
from terrain_estimator.discovery.report.investigation import investigate_as_told
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.summary import IDENTIFIED_VARIANCE
from terrain_estimator.learning.adding import Sized, add_effects
from terrain_estimator.learning.finding_model import priors
from terrain_estimator.learning.observing import observed
from terrain_estimator.model.body_motion import body_motion, safe_motion
from terrain_estimator.model.effects import laws_apart
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.physics_of_wheels import physics_by_wheel
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.model.rows import values_alone
from terrain_estimator.model.rows_beside import of_slopes
from terramechanics.effects import describe
from terramechanics.effects.grousers import BlendedGrousers
from terramechanics.effects.soil import BlendedBulldozing
from terramechanics.vehicle.wheel_places import chassis_places, wheel_order
from tests import turning_hidden
from tests.hidden.vehicle import DryBearing
from tests.turning_hidden import SKID, STEERED, driven, turning_runs

DRIVES, SECONDS = 3, 20.0
"""Drives of a case, of which the last is held out, and their length [s]."""
DRAG_SEED, NOTHING_SEED, ONLINE_SEED = 94_000_001, 94_000_002, 94_000_003
LUG_SEED, ASTRAY = 777, (3, 11)
THRUST, PRIOR_THRUST = 5.735, 100.0
"""[N] of lugs, and the deviation that is supposed."""
TORQUE = 0.5
"""[N m] of the hidden friction at high rates; half more where a wheel hardly turns."""


@pytest.fixture(scope="module")
def dragged() -> list[Blocks]:
    """Return drives whose drives have dry friction."""
    hidden = DryBearing(torch.full((DRIVES,), TORQUE, dtype=torch.float64))
    return turning_runs(SKID, hidden, DRAG_SEED, DRIVES, SECONDS)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    """Return a model by wheel without effects."""
    path = tmp_path_factory.mktemp("by_wheel") / "plain.pt"
    return model_by_wheel(SKID.rover, SKID.places, DEFAULT_PRIOR, path)


def searched(runs: list[Blocks]) -> Proven:
    with torch.inference_mode():
        study = Study(SKID.nominal, runs[:-1])
        finding = investigate_as_told(
            study, singles_by_wheel(), read_thresholds(), lambda _share, _label: None, 0.0
        )
        return proven(finding, study, runs[-1:])


def test_dry_friction_of_the_drives_is_named_and_the_error_on_the_held_out_drive_shrinks(
    dragged: list[Blocks],
) -> None:
    outcome = searched(dragged)
    judgement, proof = outcome.finding.judgement, outcome.proof
    assert judgement.verdict is Verdict.NAMED
    assert [each.label for each in judgement.named] == ["coulomb_drag"]
    ((_, size, sd),) = outcome.finding.candidate(judgement.named[0]).sizes
    # Stribeck's rise to 1.5 TORQUE is no part of the library's law
    assert TORQUE - 3.0 * sd < size < 1.5 * TORQUE + 3.0 * sd
    assert proof is not None
    assert proof.added
    assert proof.gap is None  # no turn is simulated ahead
    gap = proof.one_step_gap
    assert gap.after is not None
    assert gap.after < gap.before
    assert gap.improvement_95 is not None
    assert gap.improvement_95[0] > 0.0


def test_where_nothing_is_hidden_nothing_is_named() -> None:
    outcome = searched(turning_runs(SKID, None, NOTHING_SEED, DRIVES, SECONDS))
    assert outcome.finding.judgement.verdict is Verdict.NONE
    assert not outcome.finding.judgement.named


def test_effects_without_a_column_by_wheel_are_listed_with_the_reason(
    dragged: list[Blocks],
) -> None:
    competing = {hypothesis.label for hypothesis in singles_by_wheel()}
    assert not competing & set(NOT_BY_WHEEL)
    by_axle = {name for each in singles() for name in each.names}
    assert by_axle <= competing | set(NOT_BY_WHEEL)
    assert "lateral_bulldozing" in competing
    with torch.inference_mode():
        study = Study(SKID.nominal, dragged[:-1])
        apart = isolability(study, singles_by_wheel(("coulomb_drag", "grousers")), study.nothing)
    assert apart.not_testable == NOT_BY_WHEEL
    assert all(apart.not_testable.values())
    with pytest.raises(ConfigError, match=r"effect latency is not testable by wheel: .*slips"):
        singles_by_wheel(("coulomb_drag", "latency"))


@pytest.mark.parametrize("together", [1, 4])
def test_without_an_effect_the_rows_are_those_of_the_model_by_wheel(
    dragged: list[Blocks], together: int
) -> None:
    """Second by second as the estimator evaluates them.

    Several seconds share the deviation of the ground's banks, which is noise of the rows and moves
    the inputs on which they agree: those are compared at the measured inputs, without the noise.
    """
    nominal, blocks = SKID.nominal, dragged[0].between(0, together)
    point = LinearizationPoint(
        torch.tensor([0.8, 0.6], dtype=torch.float64),
        torch.zeros(nominal.uncertain.shape[0], dtype=torch.float64),
        (),
    )
    theta = torch.cat([point.theta, torch.ones(1, dtype=torch.float64)])
    chosen = torch.ones(len(nominal.row_names), dtype=torch.float64)
    names = ["features", "target", "variance", "used"]
    with torch.inference_mode():
        every = WheelRows(nominal, blocks, [])
        around = every.expansion(point, chosen)
        if together == 1:
            assert bool(around.input_correction.any())
            names.append("noise")
        else:
            around = Expansion(*map(torch.zeros_like, around))
        found = every.rows(point, around)
        known = SOIL.constants().unsqueeze(0)
        physics = physics_by_wheel(SKID.rover, SKID.places, known, DEFAULT_PRIOR.constants_sd)
        contact = values_alone(physics.nominal.contact(0, point.kappa))
        single = []
        for packed in blocks.packed:
            frame = physics.frame(packed, contact)
            inputs, doubt = packed, torch.zeros_like(around.doubt[: packed.shape[0]])
            if together == 1:
                none = torch.zeros_like(frame.usable)
                inputs, doubt = physics.agreed(frame, packed, contact, theta, chosen, none)
            rows = physics.rows(frame, inputs, contact, doubt)
            motion = safe_motion(body_motion(frame.measured), frame.usable)
            single.append(
                of_slopes(physics.body(), rows, frame, motion, physics.nominal.moment_variance)
            )
    for name in names:
        parts = [getattr(each, name) for each in single]
        expected = torch.cat(parts, 1 if name in ("features", "noise") else 0)
        torch.testing.assert_close(getattr(found, name), expected, msg=name)


def test_a_model_by_wheel_with_an_effect_loads_and_estimates_its_size_in_turns(
    plain: LoadedModel, tmp_path: Path
) -> None:
    generator = torch.Generator().manual_seed(ONLINE_SEED)
    drag = DryBearing(torch.full((1,), TORQUE, dtype=torch.float64))
    samples, _, plant = driven(SKID, drag, 1, 10.0, generator)
    order = [chassis_places(SKID.rover)[k] for k in wheel_order(SKID.rover)]
    (drive,) = observed(SKID.rover, samples, order, generator, plant)
    add_effects(plain, [Sized("coulomb_drag", TORQUE, 0.5 * TORQUE)], tmp_path / "dragged.pt")
    model = load_model(str(tmp_path / "dragged.pt"))
    assert [each.name for each in model.effects] == ["coulomb_drag"]
    assert model.metadata.wheel_places == SKID.places
    estimator = Estimator(model, CoreConfig())
    updates = [
        estimator.update(replace(one, stamp_ns=round(1e8 * (k + 1)))) for k, one in enumerate(drive)
    ]
    assert sum(each.decision.outcome.used for each in updates) > 0.9 * len(updates)
    for update in updates:
        assert np.isfinite(update.estimate.mean).all()
        assert np.isfinite(update.estimate.covariance).all()
    (effect,) = updates[-1].estimate.effects
    assert math.isfinite(effect.mean)
    assert 0.0 < effect.sd < 0.5 * TORQUE


@pytest.mark.parametrize(
    ("effect", "confirmed"), [("coulomb_drag", True), ("rate_dependence", False)]
)
def test_an_effect_whose_law_may_be_another_leaves_a_sharp_estimate_unconfirmed(
    plain: LoadedModel, tmp_path: Path, effect: str, *, confirmed: bool
) -> None:
    generator = torch.Generator().manual_seed(ONLINE_SEED)
    samples, _, plant = driven(SKID, None, 1, 60.0, generator)
    order = [chassis_places(SKID.rover)[k] for k in wheel_order(SKID.rover)]
    (drive,) = observed(SKID.rover, samples, order, generator, plant)
    add_effects(plain, [Sized.of_library(effect)], tmp_path / "with_effect.pt")
    model = load_model(str(tmp_path / "with_effect.pt"))
    estimator = Estimator(model, CoreConfig())
    last = [estimator.update(one) for one in drive][-1]
    left = np.diag(last.estimate.covariance) / np.array(model.metadata.prior_sd) ** 2
    assert (left < IDENTIFIED_VARIANCE).all()
    assert last.estimate.identified == (confirmed, confirmed)
    why = "" if confirmed else "nothing tells another law of rate_dependence from the ground"
    assert last.unconfirmed == why


def test_models_have_a_law_of_wedges_and_those_of_steered_rovers_one_of_lugs() -> None:
    for places in (None, SKID.places):
        assert laws_apart(places) == {"bulldozing": BlendedBulldozing}
    blended = {"bulldozing": BlendedBulldozing, "grousers": BlendedGrousers}
    assert laws_apart(STEERED.places) == blended
    sizes = [("grousers", 5.0, 1.0), ("drive_drag", 0.2, 0.04), ("bulldozing", 5e3, 1e3)]
    # beside the fit's: 30 % of the size, where the law is another all of it
    for places, share in ((None, 0.3), (SKID.places, 0.3), (STEERED.places, 1.0)):
        lugs, drag, wedge = priors(sizes, places)
        assert lugs.sd == pytest.approx(math.hypot(1.0, share * 5.0))
        assert drag.sd == pytest.approx(math.hypot(0.04, 0.3 * 0.2))
        assert wedge.sd == pytest.approx(math.hypot(1e3, 5e3))


def test_lugs_on_steered_wheels_do_not_lead_a_model_with_grousers_astray(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thrust with s and i_0 unknown, expanded every second, ended 7 deviations from c in one."""
    monkeypatch.setattr(turning_hidden, "CONSTANTS_OFF", 0.0)
    prior = replace(DEFAULT_PRIOR, constants_sd=0.0)
    rover, lugs = STEERED.rover, describe("grousers")
    generator = torch.Generator().manual_seed(LUG_SEED)
    effect = lugs.acting(lugs.values(THRUST))
    samples, strength, plant = driven(STEERED, effect, 12, 30.0, generator)
    order = [chassis_places(rover)[k] for k in wheel_order(rover)]
    noise = torch.Generator().manual_seed(LUG_SEED + 1)
    drives = observed(rover, samples, order, noise, plant)
    known = model_by_wheel(rover, STEERED.places, prior, tmp_path / "plain.pt")
    add_effects(known, [Sized("grousers", 0.0, PRIOR_THRUST)], tmp_path / "lugs.pt")
    model = load_model(str(tmp_path / "lugs.pt"))
    for number in ASTRAY:
        estimator = Estimator(model, CoreConfig())
        estimate = [estimator.update(one) for one in drives[number]][-1].estimate
        (found,) = estimate.effects
        assert found.sd < 0.1 * PRIOR_THRUST
        assert abs(found.mean - THRUST) < 3.0 * found.sd
        spread = np.sqrt(np.diag(estimate.covariance))
        assert (np.abs(estimate.mean - strength[number].numpy()) < 3.0 * spread).all()


@pytest.mark.parametrize(
    ("effect", "advice"),
    [
        ("payload", "give the loaded mass in the rover file instead"),
        ("multipass", "is not known in a turn"),
        ("latency", "subtract the latency from the stamps"),
    ],
)
def test_an_effect_that_a_model_by_wheel_cannot_have_is_refused_with_advice(
    plain: LoadedModel, tmp_path: Path, effect: str, advice: str
) -> None:
    sized = Sized.of_library(LibraryEffect(effect).name)
    with pytest.raises(ConfigError, match=f"effect {effect} cannot be added to a model by wheel"):
        add_effects(plain, [sized], tmp_path / "model.pt")
    with pytest.raises(ConfigError, match=advice):
        add_effects(plain, [sized], tmp_path / "model.pt")
    assert not list(tmp_path.iterdir())
