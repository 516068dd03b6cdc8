# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Constants of the rover file that are off: within their stated deviation, and beyond it."""

import dataclasses
import math
from functools import cache, partial

import pytest
import torch

from rover_parameters.records import ConfigError
from terrain_estimator.discovery.evidence.expected import stage
from terrain_estimator.discovery.evidence.isolability import matrix, signatures, stages_of
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import Judgement, Verdict, read_thresholds
from terrain_estimator.discovery.hypotheses.doubted_rows import DoubtedRows, rows_of
from terrain_estimator.discovery.hypotheses.library import Hypothesis, singles, together
from terrain_estimator.discovery.hypotheses.rover_doubt import (
    DOUBTABLE,
    HELD,
    WITHIN,
    RoverDoubt,
    is_within,
    ordinary_doubt,
    rover_doubt,
    rover_with,
)
from terrain_estimator.discovery.hypotheses.rows import (
    HypothesisRows,
    LinearizationPoint,
    nominal_of,
)
from terrain_estimator.discovery.proof.proof import models_of, prove
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.report.investigation import investigate, may_be_the_file
from terrain_estimator.discovery.runs import Blocks, RecordedRun, cut
from terrain_estimator.learning.tasks import measure_tasks
from terrain_estimator.offline.finding_content import exact_constants
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import Drive
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.vehicle.rover import Rover

MARS, LOOSE = load_rover("mars_rover"), load_soil("loose_sand")
STATED = {"mass": 5.0, "centre_of_mass_x": 0.01, "wheel_radius": 0.0006}
STRENGTH = ((2500.0, 0.6), (1500.0, 0.7), (2000.0, 0.65))
LIBRARY = singles(("payload", "slope_bias", "drive_drag"))


def quiet(_share: float, _label: str) -> None:
    """Report no progress."""


@cache
def driven(mass: float, radius: float = 0.0) -> Drive:
    """Return three drives of a rover that is off by these stated deviations."""
    true = rover_with(MARS, rover_doubt(MARS, STATED), (mass, radius, 0.0))
    generator = torch.Generator().manual_seed(47)
    ground = Ground([Patch(LOOSE.constants(), torch.tensor(STRENGTH, dtype=torch.float64))])
    return simulate(true, ground, "S1", 25.0, generator, len(STRENGTH))


@cache
def runs(mass: float) -> tuple[Blocks, ...]:
    drive = driven(mass)
    packed = measure_tasks(drive, Noise(), torch.Generator().manual_seed(48)).measured
    time = torch.arange(packed.shape[1], dtype=torch.float64) * 0.1
    recorded = (
        RecordedRun(f"run {k}", packed[k], drive.seen.wheel_rate[k], time)
        for k in range(len(STRENGTH))
    )
    return tuple(cut(run, nominal_of(MARS, LOOSE).contact) for run in recorded)


@cache
def study(mass: float, doubt: RoverDoubt = ()) -> Study:
    nominal = dataclasses.replace(nominal_of(MARS, LOOSE), doubt=doubt)
    with torch.inference_mode():
        return Study(nominal, runs(mass)[:2])


@cache
def found(mass: float, doubt: RoverDoubt = ()) -> Finding:
    with torch.inference_mode():
        return investigate(study(mass, doubt), LIBRARY, read_thresholds(), quiet)


def test_a_mass_that_is_off_is_called_a_payload_where_the_file_counts_as_exact() -> None:
    finding = found(1.0)
    assert finding.judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)
    assert finding.judgement.named[0].label == "payload"
    assert finding.constants == []
    assert "mass" in exact_constants(finding)


def test_a_mass_within_its_stated_deviation_is_none_and_is_found() -> None:
    finding = found(1.0, rover_doubt(MARS, {"mass": 5.0}))
    assert finding.judgement.verdict is Verdict.NONE
    [mass] = finding.constants
    assert (mass.name, mass.effect, mass.named) == ("mass", "payload", False)
    assert exact_constants(finding) == []
    assert abs(mass.moved - 1.0) < 3.0 * mass.moved_sd < 1.5
    assert not mass.is_notable
    entry = mass.plain()
    assert entry["found"] == pytest.approx(185.0 + 5.0 * mass.moved)
    assert entry["unit"] == "kg"


def test_a_mass_of_five_stated_deviations_is_a_payload_of_the_whole_size() -> None:
    doubt = rover_doubt(MARS, {"mass": 5.0})
    finding = found(5.0, doubt)
    assert [each.label for each in finding.judgement.named] == ["payload"]
    [(_, size, sd)] = finding.best.sizes
    assert abs(size - 25.0) < 2.0 * sd < 10.0
    assert finding.nothing.fit.point.shared.tolist() == [WITHIN]
    [mass] = finding.constants
    assert mass.named
    assert mass.is_notable
    assert mass.moved == pytest.approx(size / 5.0)
    assert mass.moved_sd == pytest.approx(sd / 5.0)


def test_the_proof_compares_a_payload_with_the_mass_as_told() -> None:
    doubt = rover_doubt(MARS, {"mass": 5.0})
    finding, there = found(5.0, doubt), study(5.0, doubt)
    with torch.inference_mode():
        without = there.without(finding.best)
        proof = prove(there.nominal, finding.best, runs(5.0)[2:], nothing=without)
    assert abs(float(without.fit.point.shared[0])) * HELD < 0.05
    assert there.without(there.nothing) is there.nothing
    assert proof.added
    assert proof.gap is not None
    assert proof.gap.after is not None
    assert proof.gap.after < proof.gap.before


def test_runs_tell_a_payload_from_nothing_no_further_than_the_mass_is_known() -> None:
    found_nats = []
    for sd in (0.0, 1.0, 5.0, 15.0):
        there = study(0.0, rover_doubt(MARS, {"mass": sd}))
        with torch.inference_mode():
            marks = signatures(there, there.doubting(LIBRARY), there.nothing)
            found_nats.append(matrix(stages_of(there.nothing), marks))
    payload = [float(each[0, 0]) for each in found_nats]
    assert payload[0] > payload[1] > payload[2] > payload[3] > 0.0
    assert payload[3] < 0.25 * payload[0]
    drag = [float(each[2, 2]) for each in found_nats]
    assert drag[0] > drag[3] > payload[3]  # on level ground a mass takes up a part of it


def test_where_no_deviation_is_stated_everything_is_as_without_the_input() -> None:
    assert rover_doubt(MARS, {}) == rover_doubt(MARS, {"mass": 0.0}) == ()
    assert study(1.0).none == Hypothesis(())
    assert study(1.0).doubting(LIBRARY) == LIBRARY
    assert study(1.0).nothing.fit.point.shared.shape == (0,)
    assert type(rows_of(nominal_of(MARS, LOOSE), runs(1.0)[0], LIBRARY[0])) is HypothesisRows
    [none] = models_of(None)
    assert none.values.shape == (0,)
    [(run, fitted)] = [(study(1.0).nothing.fit.point.runs[0], study(1.0).nothing.fit.equations[0])]
    plain = stage(fitted, run, fitted.excess)
    assert plain.precision.shape == run.flat().shape


def at(values: tuple[float, ...]) -> LinearizationPoint:
    return LinearizationPoint(
        torch.tensor([2.5, 0.6], dtype=torch.float64), torch.zeros(6).double(), values
    )


def rover_off(name: str, by: float) -> Rover:
    return dataclasses.replace(MARS, **{name: getattr(MARS, name) + by})


@pytest.mark.parametrize("name", [each for each in DOUBTABLE if each != "wheel_radius"])
def test_rows_in_doubt_are_those_of_the_rover_that_has_the_constants(name: str) -> None:
    doubt = rover_doubt(MARS, {name: 0.004})
    nominal, run = nominal_of(MARS, LOOSE), runs(0.0)[0]
    there = nominal_of(rover_off(name, 0.008), LOOSE)
    rows = DoubtedRows(nominal, run, Hypothesis((), doubt))
    count = nominal.uncertain.shape[0]
    point = dataclasses.replace(at(()), kappa=torch.zeros(count).double())
    mask = torch.ones(len(nominal.row_names), dtype=torch.float64)
    expected = HypothesisRows(there, run, ())
    around = expected.expansion(point, mask)
    found_rows = rows.rows(dataclasses.replace(point, values=(2.0,)), around)
    plain = expected.rows(point, around)
    assert torch.allclose(found_rows.features, plain.features, rtol=1e-12, atol=0.0)
    assert torch.allclose(found_rows.target, plain.target, rtol=1e-12, atol=1e-15)
    told = HypothesisRows(nominal, run, ()).rows(point, around)
    assert not torch.equal(told.features, plain.features)


def test_slip_is_read_by_the_radius_in_doubt() -> None:
    """The rows at 1 + e times the radius are those of runs whose slip has that radius."""
    doubt = rover_doubt(MARS, {"wheel_radius": 0.0013})
    nominal, run = nominal_of(MARS, LOOSE), runs(0.0)[0]
    rows = DoubtedRows(nominal, run, Hypothesis((), doubt))
    read = rows._read(rover_off("wheel_radius", 0.0013))
    slip, again = run.packed[..., :3], read.packed[..., :3]
    assert torch.allclose(1.0 - again, (1.0 - slip) / 1.01, atol=1e-12)


def test_an_effect_that_stands_for_a_constant_holds_it_alone_and_in_a_pair() -> None:
    doubt = rover_doubt(MARS, STATED)
    payload, drag = (each.doubting(doubt) for each in singles(("payload", "drive_drag")))
    held = [each.sd for each in payload.doubt]
    assert held == [HELD * 5.0, 0.0006, 0.01]
    assert drag.doubt == doubt
    for pair in (together(payload, drag), together(drag, payload)):
        assert [each.sd for each in pair.doubt] == held
        assert len(pair.start()) == len(pair.typical()) == len(pair.shared().low) == 7


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"weight": 2.0}, "'weight' has no deviation here"),
        ({"wheel_radus": 0.001}, "did you mean wheel_radius?"),
        ({"mass": -1.0}, "mass=-1 is no deviation: give a number from 0 on"),
        ({"mass": math.nan}, "mass=nan is no deviation"),
        ({"mass": 70.0}, "mass=70: constants that are off by 3 deviations are those of no rover"),
        ({"centre_of_mass_x": 0.3}, "tips over"),
    ],
)
def test_deviations_that_cannot_be_are_refused(stated: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError) as error:
        rover_doubt(MARS, stated)
    assert words in str(error.value)


def test_what_a_file_is_usually_off_by_has_no_name_of_its_own() -> None:
    usual = ordinary_doubt(MARS)
    assert {each.name: each.sd / each.told for each in usual[:2]} == pytest.approx(
        {"mass": 0.01, "wheel_radius": 0.003}
    )
    least = 3.0 * 0.01 * MARS.mass
    assert is_within(usual, [("payload", 0.99 * least)])
    assert is_within(usual, [("payload", -0.99 * least)])
    assert not is_within(usual, [("payload", 1.01 * least)])
    assert is_within(usual, [("odometry_scale", 0.008)])
    assert not is_within(usual, [("odometry_scale", 0.02)])
    assert not is_within(usual, [("drive_drag", 0.001)])
    assert is_within(usual, [("drive_drag", 0.4), ("payload", 1.0)])
    assert not is_within((), [("payload", 1.0)])


def test_a_name_that_is_unproven_may_be_an_error_of_the_file() -> None:
    """The mass is 5 kg off: nothing is missing where it is in doubt."""
    usual = ordinary_doubt(MARS)
    other = next(each for each in found(1.0).candidates if each.hypothesis.names != ("payload",))
    named = Judgement(Verdict.NAMED, (other.hypothesis,), {})
    finding = dataclasses.replace(found(1.0), judgement=named)
    asked = finding, partial(study, 1.0, usual), read_thresholds()
    with torch.inference_mode():
        assert may_be_the_file(*asked) is None
        assert may_be_the_file(*asked, unproven=True) is study(1.0, usual)


def test_a_centre_of_mass_at_an_end_leaves_the_other_constants_in_doubt() -> None:
    behind = dataclasses.replace(MARS, centre_of_mass_x=-0.349)
    assert [each.name for each in ordinary_doubt(behind)] == ["mass", "wheel_radius"]
