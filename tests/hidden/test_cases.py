# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hidden cases follow from one seed; their sealed bags hold the estimator's input and no truth."""

import dataclasses
import math
from functools import cache
from pathlib import Path

import pytest
import torch

from terrain_estimator.bags import BagReader
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.model_file import load_model
from terrain_estimator.topics import INPUT_TYPES
from terramechanics.effects import EFFECTS
from terramechanics.presets import soil_names
from terramechanics.simulation.sample import Measurement
from terramechanics.simulation.sensors import Noise, measure_drive, per_wheel
from tests.hidden.cases import DRIVES, Case, Plan, draw_cases, simulate_cases
from tests.hidden.generators import GENERATORS
from tests.hidden.sealing import seal

PLAN = Plan((("coulomb_drag", 1.0), ("sinkage_bias", 1.0 / 3.0)), seconds=15.0)


@cache
def cases(plan: Plan = PLAN, seed: int = 5) -> list[Case]:
    return draw_cases(plan, 1, seed)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return seal(cases()[0], tmp_path_factory.mktemp("case"))


def values(drive: Measurement) -> torch.Tensor:
    return torch.cat(
        [getattr(drive, item.name).reshape(-1) for item in dataclasses.fields(Measurement)]
    )


def test_the_same_seed_gives_the_same_case_and_another_seed_another() -> None:
    again, other = draw_cases(PLAN, 1, 5)[0], draw_cases(PLAN, 1, 6)[0]
    assert again.truth == cases()[0].truth
    assert all(
        torch.equal(values(a), values(b))
        for a, b in zip(again.drives, cases()[0].drives, strict=True)
    )
    assert other.truth.cohesion_pa != again.truth.cohesion_pa


def test_a_case_is_five_drives_of_a_minute_at_most_with_soil_constants_of_their_own() -> None:
    case = cases()[0]
    assert len(case.drives) == DRIVES
    assert [drive.velocity.shape[0] for drive in case.drives] == [
        round(10.0 * seconds) for seconds in case.truth.seconds
    ]
    assert max(case.truth.seconds) <= PLAN.seconds
    assert len(set(case.truth.constants)) == DRIVES
    assert case.truth.plan.names == ("coulomb_drag", "sinkage_bias")


def test_the_size_of_a_hidden_law_in_the_library_s_unit_is_near_what_its_numbers_say() -> None:
    truth = cases()[0].truth
    dry, rim = truth.sizes
    assert truth.equivalents[0] == pytest.approx(dry, rel=0.05)
    assert truth.equivalents[1] == pytest.approx(
        0.13 * math.sqrt(2.0 * 0.02 / 0.13) * rim, rel=0.4
    )  # r sin(theta_1) at 20 mm
    known = [name for name, effect in GENERATORS.items() if effect.known]
    small = draw_cases(Plan(tuple((name, 0.1) for name in known), seconds=5.0), 1, 4)[0].truth
    for name, size in zip(known, small.equivalents, strict=True):
        assert EFFECTS[name].low < 10.0 * size < EFFECTS[name].high, name
        assert 0.0 < abs(size) < 0.1 * EFFECTS[name].high, name


def test_a_field_that_keeps_its_default_leaves_the_cases_as_they_were() -> None:
    assert Plan((("payload", 1.0),)).text == (
        "Plan(parts=(('payload', 1.0),), torque=True, noise_time=0.0, soil='', seconds=60.0)"
    )
    assert Plan(noise=2.0).text.endswith(", seconds=60.0, noise=2.0)")


def test_what_cannot_be_named_is_unknown_and_nothing_is_none() -> None:
    assert Plan((("tether", 1.0), ("payload", 1.0))).names == ("unknown",)
    assert Plan().names == ()


def test_half_of_the_cases_drive_on_hills_and_soils_vary() -> None:
    simulated = simulate_cases(Plan((("slope_bias", 0.1),), seconds=20.0), 8, 1)
    assert [simulated.terrains.count(kind) for kind in ("hills", "flat", "ramp")] == [4, 2, 2]
    assert {soil: simulated.soils.count(soil) for soil in simulated.soils} == {
        "loose_sand": 4,
        "regolith": 4,
    }
    hilly = simulated.drive.sample.pitch.reshape(8, -1).std(1)
    level = [kind == "flat" for kind in simulated.terrains]
    assert [bool(spread < 1e-9) for spread in hilly] == level


def test_plans_without_torque_and_with_coloured_noise_say_so_in_what_is_measured() -> None:
    assert all(
        bool(drive.torque.isnan().all())
        for drive in draw_cases(Plan(torque=False, seconds=1.0), 1, 2)[0].drives
    )
    simulated = simulate_cases(Plan(seconds=30.0), 1, 2)
    generator = torch.Generator().manual_seed(1)
    sample, rover = per_wheel(simulated.drive.rover, simulated.drive.seen), simulated.drive.rover
    noise = measure_drive(rover, sample, Noise(), generator, 0.6).velocity - sample.velocity
    assert float((noise[:, 1:] * noise[:, :-1]).mean() / noise.square().mean()) == pytest.approx(
        0.6, abs=0.05
    )
    assert float(noise.std()) == pytest.approx(0.01, rel=0.05)


def test_a_sealed_bag_holds_the_input_topics_and_nothing_else(bags: list[Path]) -> None:
    assert [bag.name for bag in bags] == [f"run_{k}" for k in range(1, DRIVES + 1)]
    for bag, drive in zip(bags, cases()[0].drives, strict=True):
        assert sorted(file.name for file in bag.iterdir()) == [
            "metadata.yaml",
            f"{bag.name}_0.mcap",
        ]
        with BagReader(bag) as reader:
            assert {topic.lstrip("/") for topic in reader.topics} == set(INPUT_TYPES)
            assert sum(1 for _ in reader.messages()) == len(INPUT_TYPES) * drive.velocity.shape[0]


def contents(bag: Path) -> bytes:
    """Return all bytes of a bag's files, and every record decompressed."""
    with BagReader(bag) as reader:
        messages = [message.topic.encode() + message.data for message in reader.messages()]
    return b"".join([*(file.read_bytes() for file in sorted(bag.iterdir())), *messages])


def test_no_byte_of_a_sealed_bag_tells_what_is_hidden(bags: list[Path]) -> None:
    truth = cases()[0].truth
    words = {
        *EFFECTS,
        *GENERATORS,
        *soil_names(),
        "ground_truth",
        "truth",
        "effect",
        "hidden",
        truth.terrain,
    }
    numbers = [
        *truth.sizes,
        *truth.cohesion_pa,
        *truth.tan_phi,
        *(value for row in truth.constants for value in row),
    ]
    for bag in bags:
        data = contents(bag)
        found = {word for word in words if word.encode() in data.lower()}
        assert not found - {"latency"}, found
        for number in numbers:
            assert torch.tensor(number, dtype=torch.float64).numpy().tobytes() not in data
            assert f"{number:.6g}".encode() not in data
        assert b"custom_data: null" in data or b"custom_data: {}" in data


def test_the_search_for_truth_finds_it_where_it_is(tmp_path: Path) -> None:
    """Search a bag whose wheel rates contain the hidden size."""
    case = cases()[0]
    size = case.truth.sizes[0]
    drive = dataclasses.replace(
        case.drives[0], wheel_rate=torch.full_like(case.drives[0].wheel_rate, size)
    )
    bag = seal(Case(case.rover, [drive], case.truth), tmp_path)[0]
    assert torch.tensor(size, dtype=torch.float64).numpy().tobytes() in contents(bag)


def test_the_estimator_reads_sealed_bags_as_drives(bags: list[Path]) -> None:
    pipeline = Pipeline(load_model(), EstimatorConfig())
    with BagReader(bags[0]) as reader:
        decided = [
            decision
            for message in reader.messages()
            for decision in pipeline.add(message.topic.lstrip("/"), reader.decode(message))
        ]
    assert len(decided) > 0.95 * cases()[0].drives[0].velocity.shape[0]


def test_measured_values_come_back_from_a_sealed_bag(bags: list[Path]) -> None:
    drive = cases()[0].drives[0]
    with BagReader(bags[0]) as reader:
        joints = next(message for message in reader.messages() if message.topic == "/joint_states")
        decoded = reader.decode(joints)
    assert decoded.effort[:-1].tolist() == drive.torque[0].tolist()
    assert decoded.position[-1] == float(drive.bogie_angle[0])
    assert not math.isnan(float(drive.torque[0, 0]))
