# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A soil file that is wrong: its constants are found, alone and beside an effect, and proven."""

import dataclasses
import math
from functools import cache, partial

import pytest
import torch
import yaml

from terrain_estimator.discovery.evidence.common_constants import COMMON_SD
from terrain_estimator.discovery.evidence.other_soils import on_other_soil
from terrain_estimator.discovery.evidence.soil_revision import revised, revised_alone
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import (
    Gains,
    Judgement,
    Verdict,
    read_thresholds,
)
from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.hypotheses.rows import nominal_of
from terrain_estimator.discovery.proof.soil_proof import Proven, proven, proven_or_told
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.report.investigation import (
    LEAST_BESIDE,
    besides_soil,
    investigate,
    investigate_as_told,
)
from terrain_estimator.discovery.runs import Blocks, RecordedRun, cut
from terrain_estimator.learning.tasks import measure_tasks
from terrain_estimator.offline.revised_soils import refuted_content, soils_content, write_soils
from terrain_estimator.pages.finding_words import soil_words
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from tests.hidden.generators import GENERATORS, Draw

MARS = load_rover("mars_rover")
TRUE, TOLD = load_soil("loose_sand"), load_soil("regolith")
STRENGTH = ((2500.0, 0.6), (1500.0, 0.7), (3500.0, 0.5))
"""Of three drives; the last is held out."""


@cache
def runs(size: float, toward_told: float = 0.0, effect: str = "payload") -> tuple[Blocks, ...]:
    """Return drives on sand whose constants are by a share on the way to those of regolith."""
    generator = torch.Generator().manual_seed(20261125)
    strength = torch.tensor(STRENGTH, dtype=torch.float64)
    constants = TRUE.constants() * (TOLD.constants() / TRUE.constants()) ** toward_told
    ground = Ground([Patch(constants, strength)])
    sizes = torch.full((3,), size, dtype=torch.float64)
    acting = GENERATORS[effect].make(Draw(sizes, torch.zeros(3, dtype=torch.long), sizes))
    plant = Plant([acting]) if size else None
    drive = simulate(MARS, ground, "S1", 35.0, generator, 3, plant=plant)
    packed = measure_tasks(drive, Noise(), generator).measured
    time = torch.arange(packed.shape[1], dtype=torch.float64) * 0.1
    contact = nominal_of(MARS, TOLD).contact
    return tuple(
        cut(RecordedRun(f"run_{k}", packed[k], drive.seen.wheel_rate[k], time), contact)
        for k in range(3)
    )


@cache
def study(payload_kg: float, told: str) -> Study:
    with torch.inference_mode():
        return Study(nominal_of(MARS, load_soil(told)), runs(payload_kg)[:2])


@cache
def found(payload_kg: float, told: str, *at_hand: str) -> Finding:
    with torch.inference_mode():
        return investigate(
            study(payload_kg, told),
            singles(("payload", "slope_bias")),
            read_thresholds(),
            lambda _share, _label: None,
            [load_soil(name) for name in at_hand],
        )


def test_a_wrong_soil_file_is_named_with_the_constants_that_fit() -> None:
    finding = found(0.0, "regolith")
    assert finding.judgement.verdict is Verdict.SOIL
    assert sum(finding.judgement.probabilities.values()) == pytest.approx(1.0)
    assert finding.judgement.probabilities["soil"] > 0.9
    assert finding.soil is not None
    (revision,) = finding.soil.revisions
    assert (revision.told, revision.runs) == (TOLD, 2)
    for name, sd in revision.sd.items():
        # k_phi goes with n: a depth of 20 mm has the same pressure under both.
        if name != "k_phi":
            true, told = getattr(TRUE, name), getattr(TOLD, name)
            assert abs(getattr(revision.found, name) - true) < max(4.0 * sd, 0.5 * abs(told - true))


def test_held_out_runs_prove_the_constants_or_refute_them() -> None:
    finding = found(0.0, "regolith")
    with torch.inference_mode():
        outcome = proven(finding, study(0.0, "regolith"), runs(0.0)[2:])
    assert outcome.finding.judgement.verdict is Verdict.SOIL
    assert outcome.soil is not None
    assert outcome.soil.holds
    assert outcome.soil.after < 0.5 * outcome.soil.before
    assert outcome.soil.sentence.startswith("the revised soils hold on held-out runs")


@pytest.mark.parametrize(("payload_kg", "named"), [(25.0, True), (0.0, False)])
def test_where_held_out_runs_refute_the_soils_a_name_on_those_told_is_the_answer(
    payload_kg: float, *, named: bool
) -> None:
    """The searched drives have a payload of 25 kg; the held-out one may have none."""
    told = study(25.0, "loose_sand")
    given = (told, singles(("payload", "slope_bias")), read_thresholds())
    as_told = partial(investigate_as_told, *given, lambda _share, _label: None)
    with torch.inference_mode():
        wrong = on_other_soil(told, [TRUE, load_soil("compact_sand")], -1e6)
        assert wrong is not None
        judgement = Judgement(Verdict.SOIL, (), {"none": 0.0, "soil": 1.0, "unknown": 0.0})
        gains = Gains((), 0.0, 0.0)
        finding = Finding(judgement, gains, (), wrong.study.nothing, (), wrong)
        asked, outcome = proven_or_told(finding, told, as_told, runs(payload_kg)[2:])
    assert outcome.soil_refuted
    assert outcome.soil_sentence.startswith("the revised soils do not hold on held-out runs")
    if named:
        assert (asked.soil, outcome.finding.judgement.verdict) == (None, Verdict.NAMED)
        assert outcome.finding.judgement.named[0].names == ("payload",)
        assert soils_content(outcome) == []
        assert [each["fits"] for each in refuted_content(outcome)] == ["compact_sand"]
    else:
        assert asked is finding
        assert outcome.finding.judgement.verdict is Verdict.UNKNOWN
        assert refuted_content(outcome) == []


def test_what_other_soils_explain_is_there_to_be_explained_on_those_told() -> None:
    told = study(25.0, "loose_sand")
    given = (told, singles(("payload", "slope_bias")), read_thresholds())
    with torch.inference_mode():
        verdicts = [
            investigate_as_told(*given, lambda _share, _label: None, explained).judgement.verdict
            for explained in (0.0, 1e4)
        ]
    assert verdicts == [Verdict.NAMED, Verdict.UNKNOWN]


def test_an_effect_is_named_beside_a_wrong_soil_file() -> None:
    finding = found(25.0, "regolith")
    assert finding.judgement.verdict is Verdict.NAMED
    assert finding.judgement.named[0].names == ("payload",)
    assert finding.soil is not None
    ((_, size, sd),) = finding.best.sizes
    assert abs(size - 25.0) < 3.0 * sd


@pytest.mark.parametrize(("payload_kg", "verdict"), [(0.0, Verdict.SOIL), (25.0, Verdict.NAMED)])
def test_the_file_of_the_right_soil_is_found_among_those_at_hand(
    payload_kg: float, verdict: Verdict
) -> None:
    finding = found(payload_kg, "regolith", "compact_sand", "regolith", "loose_sand")
    assert finding.judgement.verdict is verdict
    assert finding.soil is not None
    (revision,) = finding.soil.revisions
    assert (revision.told, revision.found, revision.runs) == (TOLD, TRUE, 2)
    assert revision.of_file
    assert not revision.is_new
    assert finding.soil.price == pytest.approx(math.log(3.0))
    if payload_kg:
        assert finding.judgement.named[0].names == ("payload",)
        ((_, size, sd),) = finding.best.sizes
        assert abs(size - payload_kg) < 3.0 * sd


def test_a_wedge_ahead_of_the_wheels_is_not_taken_for_a_soil_that_nobody_knows() -> None:
    """Constants explain as much as the effect, whose law is another, but with a c1 of 0.57."""
    with torch.inference_mode():
        pushing = Study(nominal_of(MARS, TRUE), runs(0.6, effect="bulldozing")[:2])
        assert revised(pushing, pushing.nothing) is None
        assert revised_alone(pushing, 0.0) is None
        finding = investigate(
            pushing,
            singles(("bulldozing", "payload")),
            read_thresholds(),
            lambda _share, _label: None,
        )
    assert finding.judgement.verdict is Verdict.NAMED
    assert finding.judgement.named[0].names == ("bulldozing",)
    assert finding.soil is None


def found_between(effect: str, size: float) -> Finding:
    """Return what is found where regolith is told, and files of it and of sand are at hand."""
    with torch.inference_mode():
        return investigate(
            Study(nominal_of(MARS, TOLD), runs(size, 0.4, effect)[:2]),
            singles(("exit_angle", "payload", "slope_bias", "sinkage_bias")),
            read_thresholds(),
            lambda _share, _label: None,
            [TRUE, TOLD],
        )


def test_on_ground_between_two_files_no_effect_is_named_for_the_lack_of_a_third() -> None:
    """The file of regolith, told, and that of sand both leave something that looks like effects."""
    finding = found_between("slope_bias", 0.0)
    assert finding.judgement.verdict is Verdict.SOIL
    assert finding.soil is not None
    assert not finding.soil.of_files


def test_on_ground_between_two_files_an_effect_is_named_alone() -> None:
    """Constants that are fitted without it suit another effect, and either file a second one."""
    finding = found_between("slope_bias", 0.02)
    assert finding.judgement.verdict is Verdict.NAMED
    assert finding.judgement.named[0].names == ("slope_bias",)
    assert finding.soil is not None
    assert not finding.soil.of_files


def test_constants_are_not_searched_from_those_of_another_sign() -> None:
    """A change is a factor: none leads from a positive c2 to zero or less."""
    told = study(0.0, "regolith")
    for c2 in (0.0, -0.1):
        other = dataclasses.replace(told.nominal, revised=((TOLD, TOLD.with_values(c2=c2)),))
        with torch.inference_mode():
            at = Study(other, told.runs, told.mask, told.contributions)
            assert revised(told, at.nothing, at) is None


def test_a_file_of_another_law_or_that_fits_no_better_is_not_taken() -> None:
    right = study(0.0, "loose_sand")
    scm = dataclasses.replace(load_soil("regolith"), law="scm", c2=0.0)
    with torch.inference_mode():
        assert on_other_soil(right, [TRUE, scm], 0.0) is None
        assert on_other_soil(right, [TRUE, TOLD, scm], 0.0) is None
        worse = on_other_soil(right, [TRUE, TOLD, scm], -1e6)
    assert worse is not None
    assert worse.of_files
    assert [each.found for each in worse.revisions] == [TOLD]


@pytest.mark.parametrize("right", [0, 1])
def test_a_soil_told_rightly_stays_beside_one_told_wrongly(right: int) -> None:
    """Both runs are on sand; that of number ``right`` is told so, the other to be on regolith."""
    both = tuple(
        dataclasses.replace(run, soil=TRUE if k == right else TOLD)
        for k, run in enumerate(runs(0.0)[:2])
    )
    with torch.inference_mode():
        there = on_other_soil(Study(nominal_of(MARS, TOLD), both), [TOLD, TRUE], 10.0)
    assert there is not None
    assert [(each.told, each.found) for each in there.revisions] == [(TOLD, TRUE)]


def test_each_soil_as_told_is_taken_for_another_by_itself() -> None:
    """One of two runs is told to be on regolith, the other on compact sand; both are on sand."""
    compact = load_soil("compact_sand")
    both = tuple(
        dataclasses.replace(run, soil=soil)
        for run, soil in zip(runs(0.0)[:2], (TOLD, compact), strict=True)
    )
    with torch.inference_mode():
        there = on_other_soil(Study(nominal_of(MARS, TOLD), both), [TOLD, compact, TRUE], 10.0)
    assert there is not None
    assert {(each.told, each.found) for each in there.revisions} == {(TOLD, TRUE), (compact, TRUE)}


@pytest.mark.parametrize(("share", "verdict"), [(0.9, Verdict.UNKNOWN), (1.1, Verdict.NAMED)])
def test_a_name_that_gains_little_on_revised_constants_is_unknown(
    share: float, verdict: Verdict
) -> None:
    finding = found(25.0, "regolith")
    ((first, _), *others) = finding.gains.named
    weak = dataclasses.replace(finding.gains, named=((first, share * LEAST_BESIDE), *others))
    judgement = besides_soil(dataclasses.replace(finding, gains=weak), LEAST_BESIDE)
    assert judgement.verdict is verdict
    assert judgement.named[0].names == ("payload",)
    assert sum(judgement.probabilities.values()) == pytest.approx(1.0)
    assert (judgement.probabilities["unknown"] > 0.9) == (verdict is Verdict.UNKNOWN)


def test_constants_are_not_revised_where_the_soil_file_is_right() -> None:
    assert found(0.0, "loose_sand").judgement.verdict is Verdict.NONE
    named = found(25.0, "loose_sand")
    assert named.judgement.named[0].names == ("payload",)
    assert named.soil is None


def test_the_constants_have_a_price() -> None:
    with torch.inference_mode():
        there = revised(study(0.0, "loose_sand"), study(0.0, "loose_sand").nothing)
    assert there is not None
    assert there.price > 10.0
    assert there.gain(there.study.nothing, study(0.0, "loose_sand")) < 0.0
    relative = study(0.0, "loose_sand").nominal.prior.constants_sd / 2**0.5
    least = 5 * torch.log(torch.tensor(COMMON_SD / relative)).item()
    assert there.price == pytest.approx(least, rel=0.05)


def test_soil_files_and_words_have_the_constants(tmp_path_factory: pytest.TempPathFactory) -> None:
    finding = found(0.0, "regolith")
    assert finding.soil is not None
    folder = tmp_path_factory.mktemp("out")
    (name,) = write_soils(Proven(finding), folder)
    written = load_soil(str(folder / name))
    assert written == finding.soil.revisions[0].found
    assert yaml.safe_load((folder / name).read_text())["name"] == "regolith_found"
    (content,) = soils_content(Proven(finding))
    assert content["file"] == name
    assert "shear_modulus 0.0" in soil_words(content)
    assert "instead of 0.018" in soil_words(content)
