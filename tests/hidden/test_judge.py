# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A few hidden cases from drive to verdict, and counts of answers; `make hidden` runs hundreds."""

import hashlib
import json
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from terrain_estimator.discovery.hypotheses.rover_doubt import rover_doubt
from terramechanics.presets import load_rover, load_soil
from tests.hidden.cases import ROVERS, Plan, draw_cases, simulate_cases
from tests.hidden.generators import GENERATORS
from tests.hidden.ground import SPREAD, draw_ground
from tests.hidden.judge.__main__ import FROZEN, KEPT, ROVER_FROZEN
from tests.hidden.judge.bars import (
    bars,
    conditions,
    field_bars,
    outcomes,
    proportion,
    rover_bars,
    told_and_untold,
)
from tests.hidden.judge.judging import (
    Record,
    investigated,
    judged,
    right,
    without_drive,
)
from tests.hidden.judge.page import FIELD_HEADING, field, joined, rover
from tests.hidden.judge.strata import (
    FIELD_SOILS,
    KNOWN,
    NO_FILE,
    OUTSIDE,
    ROVER_BEYOND,
    ROVER_NOTHING,
    SEED,
    TOGETHER,
    UNTOLD,
    batches,
    families,
    field_batches,
    field_families,
    nothing_batches,
    rover_batches,
)
from tests.hidden.sealing import seal

FIXED = {
    "none": Plan(seconds=30.0),
    **{name: Plan(((name, 1.0),), seconds=30.0) for name in ("payload", "gain_drift")},
}
"""Plans with nothing, a named effect, and one outside the library."""


@pytest.mark.parametrize("name", FIXED)
def test_a_sealed_case_gets_the_right_verdict(name: str, tmp_path: Path) -> None:
    case = draw_cases(FIXED[name], 1, SEED - 1)[0]
    with torch.inference_mode():
        found = investigated(seal(case, tmp_path / "bags"), case.truth.soil)
    assert found is not None
    record = judged(case, *found)
    assert record["right"], record
    if record["outcome"] in ("exact", "set"):
        proof = found[0].outcome.proof
        assert proof is not None
        assert proof.added
        assert record["gap_closed"] > 0.5


def test_a_case_of_which_no_drive_can_be_used_counts_as_wrong(tmp_path: Path) -> None:
    """Here the wheels are those of another rover."""
    case = draw_cases(Plan((("payload", 1.0),), seconds=10.0), 1, SEED - 1)[0]
    bags = seal(case, tmp_path / "bags")
    assert investigated(bags, case.truth.soil, load_rover("four_wheel_rover")) is None
    record = without_drive(case) | {"family": "field, one effect"}
    assert not record["right"]
    assert "payload | 1 |  |  |  |  |  |  |  |  | 1 | 0 of 1" in outcomes([record])
    assert "0 of 1" in field_bars([record])


@pytest.mark.parametrize(
    ("plan", "answers"),
    [
        (Plan(), {"none"}),
        (Plan((("payload", 1.0),)), {"exact", "set"}),
        (Plan((("payload", 1.0 / 3.0),)), {"exact", "set", "none"}),
        (Plan((("payload", 0.1),)), {"exact", "set", "none"}),
        (Plan((("payload", 1.0), ("latency", 1.0))), {"exact", "set"}),
        (Plan((("tether", 1.0),)), {"unknown"}),
        (Plan(told="regolith"), {"none", "soil"}),
        (Plan((("payload", None),), told="regolith"), {"exact", "set"}),
    ],
)
def test_what_counts_as_right(plan: Plan, answers: set[str]) -> None:
    every = {"exact", "set", "part", "wrong name", "unknown", "none", "soil"}
    assert {outcome for outcome in every if right(outcome, plan)} == answers


def record(family: str, plan: str, outcome: str, **more: Any) -> Record:
    good = {"none": "none", "outside": "unknown"}.get(family, "exact")
    numbers = {
        "sizes": [(plan, 1.0, 0.1)],
        "equivalents": [1.1],
        "gap_closed": 0.9,
        "strength": [[0.4, 0.02], [0.1, 0.02]],
    }
    return (
        {"family": family, "plan": plan, "outcome": outcome, "right": outcome == good}
        | numbers
        | more
    )


def found(records: list[Record]) -> dict[str, tuple[str, str]]:
    rows = [line.strip("| ").split(" | ") for line in bars(records).splitlines()[2:]]
    return {what: (value, met.strip("| ")) for what, _, value, met in rows}


def test_bars_tell_met_from_missed_and_from_too_few_cases() -> None:
    nulls = [record("none", "none", "none")] * 395 + [record("none", "none", "wrong name")] * 5
    assert found(nulls)["nothing hidden, soil constants wrong by up to 5 %: anything named"] == (
        proportion(5, 400),
        "met",
    )
    few = found(nulls[:100])["nothing hidden, soil constants wrong by up to 5 %: anything named"]
    assert few == (proportion(0, 100), "open: 400 cases are asked for")
    many = [record("none", "none", "wrong name")] * 11 + nulls[:389]
    assert (
        found(many)["nothing hidden, soil constants wrong by up to 5 %: anything named"][1]
        == "missed"
    )
    assert found([])["outside the library: unknown"] == ("no cases", "not measured")


def test_bars_measure_names_sizes_gap_and_bias_on_cases_that_matter() -> None:
    names = [record("matters", "latency", "exact")] * 8 + [
        record("matters", "latency", "set"),
        record("matters", "latency", "unknown"),
    ]
    rows = found(
        [
            *names,
            record("tenth", "latency", "wrong name"),
            record("matters", "latency", "exact", equivalents=[1.3]),
        ]
    )
    assert rows["right name, or a confusable set with it"] == (
        proportion(10, 11),
        "open: 100 cases are asked for",
    )
    assert rows["95 % interval of the size holds that of the nearest named law"][0] == proportion(
        8, 9
    )
    assert rows["held-out gap closed on the way to the noise floor, when named, median"][
        0
    ].startswith("90% of 10")
    assert rows["bias of c after, relative to before"][0].startswith("25% of 10")
    assert rows["bias of tan phi after, relative to before"] == (
        "100% of 10 (100% to 100%)",
        "open: 80 cases are asked for",
    )


def test_outcomes_are_counted_by_family_and_effect() -> None:
    table = outcomes(
        [
            record("outside", "tether", "unknown"),
            record("outside", "crust", "wrong name"),
            record("none", "none", "none"),
        ]
    )
    assert f"| outside | all | 2 |  |  |  |  | 1 | 1 |  |  |  | {proportion(1, 2)} |" in table
    assert f"| none | none | 1 |  |  |  |  |  |  | 1 |  |  | {proportion(1, 1)} |" in table


def test_a_right_name_with_another_beside_it_has_a_column_of_its_own() -> None:
    """All four are wrong names; of the last the hidden pair is no part."""
    family, hidden = "field, one effect", "failed_wheel"
    more = [
        (hidden, ["drive_drag + failed_wheel (axle 1)"]),
        (hidden, ["drive_drag + failed_wheel (axle 1)", "failed_wheel (axle 2) + payload"]),
        (hidden, ["drive_drag + failed_wheel (axle 1)", "drive_drag"]),
        ("latency+exit_angle", ["latency + payload"]),
    ]
    table = outcomes([record(family, plan, "wrong name", named=named) for plan, named in more])
    assert f"| {family} | {hidden} | 3 |  |  |  | 2 | 1 |  |  |  |  | " in table
    assert f"| {family} | latency+exit_angle | 1 |  |  |  |  | 1 |  |  |  |  | " in table


def test_the_section_of_the_field_is_replaced_and_the_rest_of_the_page_stays() -> None:
    drawn = {"told": "regolith", "soil": "loose_sand", "noise": 1.0, "rover": "mars_rover"}
    records = [record("field, nothing", "none", "soil", **drawn, right=True)] * 2
    once = joined("# Page\n\n| old |\n", None, field(records, 532, "1a2b3c4d"))
    assert once.startswith(f"# Page\n\n| old |\n\n{FIELD_HEADING}")
    assert "**2 of the 532 cases are done.**" in once
    assert f"| soil told wrongly | {proportion(2, 2)} |" in once
    assert joined(once, None, field(records, 532, "1a2b3c4d")) == once
    assert joined(once, "# New\n", None) == once.replace("# Page\n\n| old |", "# New")
    assert joined("# Page\n", "# New\n", None) == "# New\n"
    assert "| field, all cases: right | at least 93% | 2 of 2" in field_bars(records)
    assert conditions(records).count("|---") == 2
    alone = [record(NO_FILE, "payload", "exact", **drawn, right=True)]
    assert "told one of them | 1 of 1" in conditions(alone)
    assert "soil told" not in conditions(alone)
    assert "all cases: right | at least 93% | no cases" in field_bars(alone)


def test_limits_are_those_of_clopper_and_pearson() -> None:
    assert proportion(0, 200) == "0 of 200 = 0.0% (0.0% to 1.8%)"  # 1 - 0.025^(1/200)


def test_the_sample_has_every_effect_at_three_sizes_and_at_least_200_cases_of_nothing() -> None:
    sample = batches(whole=False)
    keys = [key for batch in sample for key in batch.keys]
    assert len(set(keys)) == len(keys)
    counts = Counter(
        {
            family: TOGETHER * count
            for family, count in Counter(batch.family for batch in sample).items()
        }
    )
    assert counts["none"] >= 200
    assert {
        name
        for family in ("matters", "third", "tenth")
        for plan in families()[family][0]
        for name in plan.names
    } == set(KNOWN)
    assert set(KNOWN) | set(OUTSIDE) == set(GENERATORS)


def test_the_field_is_drawn_from_the_commit_that_froze_the_rule() -> None:
    field = field_batches("1a2b3c4d5e")
    assert field == field_batches("1a2b3c4dffff")
    assert field != field_batches("1a2b3c4e5e")
    keys = [key for batch in field for key in batch.keys]
    assert len(set(keys)) == len(keys)
    between = [batch.plan for batch in field if batch.family == NO_FILE]
    assert all(plan.told and 0.3 <= plan.between <= 0.7 for plan in between)
    field = [batch for batch in field if batch.family != NO_FILE]
    assert len(field) >= 500
    told = sum(bool(batch.plan.told) for batch in field) / len(field)
    noisy = [batch.plan.noise for batch in field if batch.plan.noise != 1.0]
    assert 0.2 < told < 0.47
    assert 0.2 < len(noisy) / len(field) < 0.47
    assert 0.5 <= min(noisy) < max(noisy) <= 2.0
    assert {batch.plan.rover for batch in field} == set(ROVERS)
    assert all(batch.plan.told != batch.plan.soil for batch in field)
    first = field[: len(field) // 5]
    assert {batch.family for batch in first} == set(field_families()) - {NO_FILE}
    assert {(batch.plan.rover, batch.plan.soil) for batch in first} == {
        (rover, soil) for rover in ROVERS for soil in FIELD_SOILS
    }


def test_where_nothing_is_hidden_and_all_told_rightly_rovers_and_soils_are_drawn() -> None:
    nothing = nothing_batches("1a2b3c4d5e")
    assert nothing == nothing_batches("1a2b3c4dffff") != nothing_batches("1a2b3c4e5e")
    assert len({key for each in nothing for key in each.keys}) == len(nothing) == 400
    plans = {each.plan for each in nothing}
    assert plans == {Plan(soil=soil, rover=rover) for soil in FIELD_SOILS for rover in ROVERS}


def test_what_is_drawn_for_rovers_leaves_the_cases_of_before() -> None:
    """The digest is that of before there were such rovers."""
    frozen = "befa0b6e202c572df4b965ff88c2a40817ec6fe3"
    every = [*field_batches(frozen), *batches(whole=False)]
    words = "\n".join(f"{each.keys} {each.plan.text} {each.seed} {each.first}" for each in every)
    digest = hashlib.sha256(words.encode()).hexdigest()
    assert digest == "ed8dc9f7667bcfabdb92086dc639455d3ed834d3ce8eaf2e205101edf3158cb1"


def test_rovers_are_off_within_their_stated_deviations_but_for_one_family() -> None:
    drawn = rover_batches("1a2b3c4d5e")
    assert drawn == rover_batches("1a2b3c4dffff") != rover_batches("1a2b3c4e5e")
    assert len({key for batch in drawn for key in batch.keys}) == len(drawn) > 200
    for batch in drawn:
        stated, off = dict(batch.plan.stated), dict(batch.plan.off)
        assert stated.keys() == off.keys() == {"mass", "wheel_radius", "centre_of_mass_x"}
        far = {name: abs(off[name]) / stated[name] for name in off}
        beyond = [name for name, share in far.items() if share > 2.5]
        assert all(share <= 2.5 or 3.0 <= share <= 5.0 for share in far.values())
        assert len(beyond) == (batch.family == ROVER_BEYOND)
        assert batch.plan.beyond == "".join(beyond)
        assert batch.plan.file is not None
        rover_doubt(batch.plan.file, stated)  # deviations that the search takes
    untold = rover_batches("1a2b3c4d5e", untold=True)
    assert [each.plan for each in untold] == [each.plan for each in drawn]
    assert {each.seed for each in untold} == {each.seed for each in drawn}
    assert not {key for each in untold for key in each.keys} & {
        key for each in drawn for key in each.keys
    }


STATED = (("mass", 2.0), ("wheel_radius", 0.0005), ("centre_of_mass_x", 0.01))


def off(mass: float, radius: float = 0.0) -> Plan:
    errors = (("mass", mass), ("wheel_radius", radius), ("centre_of_mass_x", 0.0))
    return Plan(rover="mars_rover", stated=STATED, off=errors)


def test_what_counts_as_right_of_a_rover_that_is_off() -> None:
    within, beyond = off(4.0), off(-7.0)
    assert (within.names, beyond.names) == ((), ("payload",))
    assert off(0.0, 0.002).names == ("odometry_scale",)
    assert right("none", within)
    assert not right("wrong name", within)
    assert right("exact", beyond)
    assert right("set", beyond)
    assert not right("exact", beyond, holds=False)
    assert not right("none", beyond)
    small, large = (replace(within, parts=(("payload", None),)) for _ in range(2))
    assert right("none", small, (4.9,))
    assert not right("none", large, (5.1,))
    assert right("exact", large, (5.1,))
    drag = replace(within, parts=(("coulomb_drag", None),))
    assert not right("none", drag, (0.3,))


def test_readings_of_a_rover_that_is_off_are_computed_with_the_radius_of_its_file() -> None:
    plan = replace(off(-7.0, 0.0013), seconds=5.0, soil="regolith")
    case, simulated = draw_cases(plan, 1, 3)[0], simulate_cases(plan, 1, 3)
    assert case.rover == load_rover("mars_rover") == simulated.told
    assert simulated.drive.rover.mass == 178.0
    assert simulated.drive.rover.wheel_radius == pytest.approx(0.1313)
    seen, measured = simulated.drive.seen, simulated.measured
    slip = 1.0 - seen.velocity.unsqueeze(-1) / (0.13 * seen.wheel_rate)
    read = measured.slip.view(*slip.shape, -1).mean(-1)
    assert float((read - slip).mean()) == pytest.approx(0.0, abs=2e-3)
    assert float((read - seen.slip).mean()) < -5e-3


@pytest.mark.parametrize("name", ["field", "rover"])
def test_records_that_are_kept_are_those_of_cases_each_once_with_its_commit(name: str) -> None:
    lines = (KEPT / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()
    records = [json.loads(line) for line in lines]
    batches_of = {
        "field": [*field_batches(FROZEN), *nothing_batches(FROZEN)],
        "rover": [
            *rover_batches(ROVER_FROZEN),
            *rover_batches(ROVER_FROZEN, untold=True),
        ],
    }[name]
    plans = {key: each.plan for each in batches_of for key in each.keys}
    keys = [each["key"] for each in records]
    assert len(keys) == len(set(keys))
    assert set(keys) <= set(plans)
    for each in records:
        assert re.fullmatch(r"[0-9a-f]{8,}", each["commit"])
        assert each["right"] in (True, False)
        if not plans[each["key"]].beyond:  # there the size counts, too
            sizes = each["equivalents"]
            assert each["right"] == right(each["outcome"], plans[each["key"]], sizes), each["key"]


def test_told_and_untold_are_compared_case_by_case() -> None:
    told = [record(ROVER_NOTHING, "none", "none", key=f"{ROVER_NOTHING}/{k}") for k in range(3)]
    told = [each | {"right": True} for each in told]
    name = f"{ROVER_NOTHING}{UNTOLD}"
    untold = [record(name, "none", "wrong name", key=f"{name}/{k}") for k in range(2)]
    untold = [each | {"right": False} for each in untold]
    parts = [proportion(2, 2), proportion(0, 2), proportion(0, 2), proportion(2, 2)]
    assert f"| {ROVER_NOTHING} | 2 | {' | '.join(parts)} |" in told_and_untold([*told, *untold])
    found_there = {"moved": {"mass": [0.5, 0.1]}, "off": {"mass": 1.2}, "stated": {"mass": 2.0}}
    told[0] |= found_there
    told[1] |= found_there | {"off": {"mass": 1.6}}
    pointed = {"moved": {"mass": [2.4, 0.3]}, "off": {"mass": 7.0}, "stated": {"mass": 2.0}}
    beyond = record(ROVER_BEYOND, "mass", "none", key="beyond") | pointed | {"right": False}
    other_way = beyond | {"off": {"mass": -7.0}, "key": "other"}
    assert "points at the constant | at least 80% | 1 of 2" in rover_bars([beyond, other_way])
    told[0] |= {"commit": "5e6f7a8b"}
    section = rover([*told, *untold], 205, "1a2b3c4d")
    assert "Examined: 1 at 5e6f7a8b, 4 at unknown." in section
    assert f"| mass | 0.22 | {proportion(1, 2)} |" in section
    page = joined("# Page\n", None, None, section)
    assert "**3 of the 205 cases are done.**" in page
    assert joined(page, None, None, section) == page
    assert joined(page, None, f"{FIELD_HEADING}\nfield\n").endswith(section)


def test_a_case_of_the_field_has_its_rover_and_states_other_noise_than_it_has() -> None:
    plan = Plan(seconds=20.0, soil="regolith", noise=2.0, rover="light_rover")
    noisy = simulate_cases(plan, 1, 3)
    plain = simulate_cases(replace(plan, noise=1.0), 1, 3)
    assert noisy.drive.rover.mass < 0.7 * load_rover("mars_rover").mass
    assert torch.equal(noisy.measured.pitch_sd, plain.measured.pitch_sd)
    errors = [each.measured.pitch - each.drive.seen.pitch for each in (noisy, plain)]
    assert float(errors[0].std() / errors[1].std()) == pytest.approx(2.0, rel=0.01)


def test_ground_without_a_file_lies_between_that_told_and_the_one_drawn() -> None:
    named = [load_soil(name).constants() for name in ("loose_sand", "regolith")]
    drawn = torch.Generator().manual_seed(3)
    for share, middle in ((0.5, (named[0] * named[1]).sqrt()), (0.0, named[0])):
        ground = draw_ground(["loose_sand"] * 50, drawn, "regolith", share)
        assert bool(((ground.patches[0].constants / middle - 1.0).abs() <= SPREAD).all())


def test_a_part_of_the_sample_is_a_sample_of_every_family() -> None:
    first = {batch.family for batch in batches(whole=False)[:60]}
    assert first == set(families())
