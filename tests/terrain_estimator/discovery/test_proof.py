# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A drag of the drives, found in two runs and judged on one with it and one without it."""

import dataclasses
from collections.abc import Sequence
from functools import cache
from typing import Any, cast

import pytest
import torch

from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.evidence.verdict import Gains, Judgement, Verdict
from terrain_estimator.discovery.hypotheses.library import NOTHING, singles
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.proof.gap import Gap
from terrain_estimator.discovery.proof.held_out import Half, Model, long_enough
from terrain_estimator.discovery.proof.proof import Proof, halves, prove, settled
from terrain_estimator.discovery.proof.rollout import determined, simulated, windows_of
from terrain_estimator.discovery.proof.rule import (
    DECISIVE,
    LIKELIER,
    better,
    contradicts,
    harms,
    is_proven,
    is_undecided,
)
from terrain_estimator.discovery.proof.terrain import track_of
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.runs import Blocks, RecordedRun, RunError, cut
from terrain_estimator.learning.tasks import measure_tasks
from terramechanics.effects import make_effect
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import Drive
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch

MARS, LOOSE = load_rover("mars_rover"), load_soil("loose_sand")
DRAG = (0.3, 0.3, 0.3, 0.0)
"""[N m s/rad] Of four drives: two to find it in, one that has it, one that has not."""
STRENGTH = ((2500.0, 0.6), (1500.0, 0.7), (2000.0, 0.65), (3000.0, 0.55))


def rolled(proof: Proof) -> Gap:
    assert proof.gap is not None
    return proof.gap


@cache
def drives() -> tuple[Drive, tuple[Blocks, ...]]:
    generator = torch.Generator().manual_seed(43)
    plant = Plant([make_effect("drive_drag", torch.tensor(DRAG, dtype=torch.float64))])
    ground = Ground([Patch(LOOSE.constants(), torch.tensor(STRENGTH, dtype=torch.float64))])
    drive = simulate(MARS, ground, "S1", 24.0, generator, len(DRAG), plant=plant)
    packed = measure_tasks(drive, Noise(), generator).measured
    time = torch.arange(packed.shape[1], dtype=torch.float64) * 0.1
    runs = (
        RecordedRun(f"run {k}", packed[k], drive.seen.wheel_rate[k], time) for k in range(len(DRAG))
    )
    return drive, tuple(cut(run, nominal_of(MARS, LOOSE).contact) for run in runs)


@cache
def found() -> Candidate:
    with torch.inference_mode():
        return Study(nominal_of(MARS, LOOSE), drives()[1][:2]).explain(singles(("drive_drag",))[0])


@cache
def proven(run: int) -> Proof:
    with torch.inference_mode():
        return prove(nominal_of(MARS, LOOSE), found(), [drives()[1][run]])


def test_an_effect_that_is_there_closes_the_gap_of_a_run_that_it_was_not_fitted_to() -> None:
    proof = proven(2)
    assert proof.added
    assert "is added" in proof.sentence
    for gap in (rolled(proof), proof.one_step_gap):
        assert gap.before > 2.0 * gap.noise_floor
        assert gap.closed is not None
        assert gap.closed > 0.8
        assert gap.closed_95 is not None
        assert gap.closed_95[0] > 0.6
    whole = {(score.kind, score.row): score for score in proof.rows if score.region == "everywhere"}
    for kind in ("one_step", "rollout"):
        score = whole[kind, "all rows"]
        assert score.coverage[1] is not None
        assert score.coverage[0] < 0.8 < score.coverage[1]
        assert score.nll[1] is not None
        assert score.nll[1] < score.nll[0]
    for strength in proof.parameters:
        assert strength.tan_phi[1] is not None
        assert abs(strength.tan_phi[1] - STRENGTH[2][1]) < abs(strength.tan_phi[0] - STRENGTH[2][1])


def test_every_measured_signal_of_the_worst_window_is_kept_the_worst_first() -> None:
    series = proven(2).rollouts
    wheels = {f"{name}_{k}" for name in ("slip", "sinkage", "torque") for k in range(3)}
    assert {each.signal for each in series} == {"velocity"} | wheels
    worst = series[0]
    assert worst.after is not None

    def missed(simulated: Sequence[float | None]) -> float:
        pairs = zip(worst.measured, simulated, strict=True)
        return sum((a - b) ** 2 for a, b in pairs if a is not None and b is not None)

    assert missed(worst.after) < missed(worst.before)


def test_an_effect_that_the_held_out_run_lacks_is_not_added() -> None:
    proof = proven(3)
    gap = rolled(proof)
    assert gap.after is not None
    assert gap.after > gap.before
    assert not proof.added
    assert "is not added" in proof.sentence


def test_held_out_runs_are_likelier_with_the_effect_only_where_they_have_it() -> None:
    there, not_there = proven(2).log_bayes_factor, proven(3).log_bayes_factor
    assert there is not None
    assert not_there is not None
    assert there > LIKELIER
    assert not_there < 0.0


def test_a_run_with_the_effect_is_as_much_likelier_as_is_expected_of_it() -> None:
    """Of F nat a Gaussian scatters by sqrt(2 F): three of these deviations."""
    proof = proven(2)
    seen, expected = proof.log_bayes_factor, proof.expected_log_bayes_factor
    assert seen is not None
    assert expected is not None
    assert expected > 10.0 * LIKELIER
    assert abs(seen - expected) < 3.0 * (2.0 * expected) ** 0.5


@cache
def proven_small(run: int) -> Proof:
    """Return the proof of a hundredth of the drag, too little for a run of 24 s to show."""
    fit = found().fit
    small = dataclasses.replace(fit, point=fit.point.with_shared(0.01 * fit.point.shared))
    with torch.inference_mode():
        nominal, there = nominal_of(MARS, LOOSE), dataclasses.replace(found(), fit=small)
        return prove(nominal, there, [drives()[1][run]])


def test_a_run_that_hardly_shows_an_effect_does_not_refute_it() -> None:
    proof = proven_small(3)
    assert proof.expected_log_bayes_factor is not None
    assert 0.0 <= proof.expected_log_bayes_factor < 1.0
    assert not proof.added
    assert proof.undecided
    assert "is neither proven nor refuted" in proof.sentence
    refuted = proven(3)
    assert not refuted.undecided
    assert refuted.expected_log_bayes_factor is not None
    assert refuted.expected_log_bayes_factor > DECISIVE


@pytest.mark.parametrize(
    ("likelier", "expected", "proves", "undecided"),
    [
        (7.0, 7.9, False, True),
        (7.0, 8.1, True, False),
        (9.0, 7.9, True, False),
        (-7.0, 17.9, True, False),
        (7.0, None, True, False),
    ],
)
def test_runs_that_help_prove_an_effect_only_where_they_should(
    likelier: float, expected: float | None, *, proves: bool, undecided: bool
) -> None:
    gap = dataclasses.replace(rolled(proven(2)), improvement_95=(0.1, 0.3), closed_95=None)
    step_gap = dataclasses.replace(gap, nll_improvement_95=(-0.1, 0.2))
    assert is_proven(gap, step_gap, likelier, expected) == proves
    assert is_undecided(gap, step_gap, likelier, expected) == undecided


@pytest.mark.parametrize(
    ("likelier", "expected", "undecided"),
    [
        (7.0, 17.9, True),
        (7.0, 18.1, False),
        (-7.9, 17.9, True),
        (-8.1, 17.9, False),
        (7.0, None, False),
    ],
)
def test_runs_that_do_not_help_refute_an_effect_only_where_they_should_show_it(
    likelier: float, expected: float | None, *, undecided: bool
) -> None:
    gap = dataclasses.replace(rolled(proven(2)), improvement_95=(-0.1, 0.3), closed_95=None)
    step_gap = dataclasses.replace(gap, nll_improvement_95=(-0.1, 0.2))
    assert not is_proven(gap, step_gap, likelier, expected)
    assert is_undecided(gap, step_gap, likelier, expected) == undecided


def test_a_run_that_hardly_shows_an_effect_refutes_it_where_predictions_get_worse() -> None:
    gap = dataclasses.replace(rolled(proven(2)), improvement_95=(-0.1, 0.2))
    ahead = dataclasses.replace(gap, nll_improvement_95=(-0.1, 0.2))
    assert not harms(gap, ahead)
    assert not harms(None, ahead)
    assert harms(None, dataclasses.replace(gap, nll_improvement_95=(-0.2, -0.1)))
    worse = dataclasses.replace(gap, improvement_95=(-0.3, -0.1), above_floor_95=(0.5, 1.5))
    assert harms(worse, ahead)
    assert contradicts(worse, ahead)
    far = dataclasses.replace(gap, after=3.1 * gap.noise_floor)
    assert not harms(far, ahead)
    assert contradicts(far, ahead)
    assert not contradicts(gap, ahead)


@pytest.mark.parametrize(
    ("rollouts", "ahead", "likelier", "added"),
    [
        ((0.1, 0.3), (-0.1, 0.2), 0.0, True),
        ((-0.1, 0.2), (0.1, 0.3), 0.0, True),
        ((-0.1, 0.2), (-0.1, 0.2), 9.0, True),
        ((-0.1, 0.2), (-0.1, 0.2), 7.0, False),
        ((-0.3, -0.1), (0.1, 0.3), 9.0, False),
    ],
)
def test_an_effect_is_added_that_helps_in_one_way_and_harms_in_none(
    rollouts: tuple[float, float], ahead: tuple[float, float], likelier: float, *, added: bool
) -> None:
    gap = dataclasses.replace(rolled(proven(2)), improvement_95=rollouts, above_floor_95=(0.5, 1.5))
    assert better(gap, dataclasses.replace(gap, nll_improvement_95=ahead), likelier) == added


@pytest.mark.parametrize(
    ("after", "above_floor", "ahead", "added"),
    [
        (2.6, (-0.1, 0.9), (0.1, 0.3), True),
        (2.6, (0.1, 0.9), (0.1, 0.3), False),
        (2.7, (-0.1, 0.9), (0.1, 0.3), False),
        (2.6, (-0.1, 0.9), (-0.3, -0.1), False),
        (2.6, None, (0.1, 0.3), False),
    ],
)
def test_rollouts_that_miss_by_no_more_than_expected_refute_nothing(
    after: float,
    above_floor: tuple[float, float] | None,
    ahead: tuple[float, float],
    *,
    added: bool,
) -> None:
    """The floor is 2.0; without the effect they miss by less, by chance."""
    gap = dataclasses.replace(
        rolled(proven(2)),
        before=2.3,
        after=after,
        noise_floor=2.0,
        closed_95=None,
        improvement_95=(-0.4, -0.1),
        above_floor_95=above_floor,
    )
    step_gap = dataclasses.replace(proven(2).one_step_gap, nll_improvement_95=ahead)
    assert better(gap, step_gap, 9.0) == added


@pytest.mark.parametrize(
    ("rollouts", "ahead", "added"),
    [
        ((0.05, 0.2), (0.0, 0.3), False),
        ((0.05, 0.4), (0.0, 0.3), True),
        ((0.05, 0.2), (0.1, 0.5), True),
        (None, (0.0, 0.3), False),
        ((0.05, 0.2), None, False),
        ((0.05, 0.4), None, True),
        (None, None, True),
    ],
)
def test_an_effect_that_leaves_most_of_the_gap_is_not_added(
    rollouts: tuple[float, float] | None, ahead: tuple[float, float] | None, *, added: bool
) -> None:
    """It is likelier and better than nothing; a gap that chance may have made tells nothing."""
    gap = dataclasses.replace(rolled(proven(2)), improvement_95=(0.1, 0.3), closed_95=rollouts)
    step_gap = dataclasses.replace(gap, closed_95=ahead)
    assert better(gap, step_gap, 9.0) == added
    proof = dataclasses.replace(proven(2), gap=gap, one_step_gap=step_gap, added=added)
    assert ("a third is needed" in proof.sentence) != added


def test_the_errors_of_a_right_effect_are_about_those_that_it_expects() -> None:
    gap = rolled(proven(2))
    assert gap.after is not None
    assert gap.above_floor_95 is not None
    low, high = gap.above_floor_95
    assert low <= gap.after - gap.noise_floor <= high
    assert low <= 0.0


def test_a_name_that_did_not_prove_itself_is_withdrawn() -> None:
    hypothesis = found().hypothesis
    judgement = Judgement(
        Verdict.NAMED, (hypothesis,), {"none": 0.01, "unknown": 0.04, "drive_drag": 0.95}
    )
    finding = Finding(judgement, cast("Gains", None), (found(),), found(), ())
    after = settled(finding, proven(3)).judgement
    assert after.verdict is Verdict.UNKNOWN
    assert after.named == (hypothesis,)
    assert after.probabilities == pytest.approx({"none": 0.01, "unknown": 0.99, "drive_drag": 0.0})
    assert settled(finding, proven(2)) is finding
    assert settled(finding, proven_small(3)) is finding
    assert settled(finding, None) is finding


@pytest.mark.parametrize(
    ("times", "verdict"), [(0.9, Verdict.NONE), (2.9, Verdict.NONE), (3.1, Verdict.UNKNOWN)]
)
def test_nothing_is_missing_only_where_rollouts_are_near_the_noise_floor(
    times: float, verdict: Verdict
) -> None:
    proof = proven(2)
    gap = rolled(proof)
    gap = dataclasses.replace(gap, before=times * gap.noise_floor, after=None)
    chances = {"none": 0.9, "unknown": 0.06, "drive_drag": 0.04}
    judgement = Judgement(Verdict.NONE, (), chances)
    finding = Finding(judgement, cast("Gains", None), (found(),), found(), ())
    judged = dataclasses.replace(proof, effect="", gap=gap)
    assert settled(finding, dataclasses.replace(judged, encoders=False)) is finding
    after = settled(finding, judged).judgement
    assert after.verdict is verdict
    assert after.named == ()
    surprised = {"none": 0.0, "unknown": 0.96, "drive_drag": 0.04}
    assert after.probabilities == pytest.approx(
        surprised if verdict is Verdict.UNKNOWN else chances
    )


def test_a_drag_that_no_name_and_no_row_would_show_is_far_off_in_rollouts() -> None:
    with torch.inference_mode():
        gap = rolled(prove(nominal_of(MARS, LOOSE), None, [drives()[1][2]]))
        null = rolled(prove(nominal_of(MARS, LOOSE), None, [drives()[1][3]]))
    assert gap.far_off
    assert not null.far_off


def test_what_no_run_determined_does_not_raise_the_noise_floor() -> None:
    prior_sd = torch.tensor([75.0, 10.0, 10.0], dtype=torch.float64)
    spread = torch.tensor([0.4, 0.2, 10.0], dtype=torch.float64)
    factor = determined(torch.diag(spread.square()), prior_sd)
    kept = torch.diag(torch.tensor([0.4, 0.2, 0.0], dtype=torch.float64).square())
    assert torch.allclose(factor @ factor.T, kept)


def test_the_unknown_place_of_a_payload_does_not_raise_the_noise_floor() -> None:
    """Without a bogie angle nothing tells where a payload stands."""
    load = singles(("payload",))[0]
    values = torch.tensor([15.0, 0.0, 0.0], dtype=torch.float64)
    candidate = dataclasses.replace(found(), hypothesis=load)
    floors = []
    for place_sd in (0.01, 10.0):
        covariance = torch.diag(torch.tensor([0.4, place_sd, place_sd]).double().square())
        fit = dataclasses.replace(
            candidate.fit,
            point=candidate.fit.point.with_shared(values),
            covariance=covariance,
        )
        loaded = dataclasses.replace(candidate, fit=fit)
        with torch.inference_mode():
            gap = rolled(prove(nominal_of(MARS, LOOSE), loaded, [drives()[1][3]]))
        floors.append(gap.noise_floor)
    assert floors[1] < 1.05 * floors[0]


def nominal_halves() -> tuple[Model, tuple[Half, Half]]:
    model = Model(
        NOTHING, torch.zeros(0, dtype=torch.float64), torch.zeros(0, 0, dtype=torch.float64)
    )
    return model, halves(nominal_of(MARS, LOOSE), (model,), drives()[1][3])


def test_rollouts_do_not_know_what_was_measured_of_slip_sinkage_and_torque() -> None:
    nominal, (model, judged) = nominal_of(MARS, LOOSE), nominal_halves()

    def signals(halves: Any) -> torch.Tensor:
        return simulated(nominal, halves, windows_of(nominal, halves), 0, model, seed=1).signals

    blind = []
    for half in judged:
        packed = half.blocks.packed.clone()
        packed[..., :12] = 0.1
        packed[..., 18:24] = 1.0
        blind.append(
            dataclasses.replace(half, blocks=dataclasses.replace(half.blocks, packed=packed))
        )
    with torch.inference_mode():
        assert torch.equal(signals(judged), signals(blind))


def test_the_terrain_is_read_off_the_measured_angles() -> None:
    drive, runs = drives()
    sample = drive.sample
    for k, run in enumerate(runs):
        track = track_of(run.packed.flatten(0, 1), MARS)
        true = torch.tan(sample.pitch[k].unsqueeze(1) + sample.contact_angle[k])
        error = (
            torch.from_numpy(track.spline((sample.contact[k] - sample.position[k, 0]).numpy()))
            - true[: len(sample.contact[k])]
        )
        assert (
            float(error.square().mean().sqrt()) < 0.3 * 0.0074
        )  # 0.0074 rad is the noise of one slope


def test_a_run_too_short_to_be_halved_is_refused_by_name() -> None:
    with pytest.raises(RunError, match="run 2: 12 whole seconds, a held-out run needs at least 16"):
        long_enough(drives()[1][2].between(0, 12))
