# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect reads bags as the estimator does, and names what it cannot use."""

import dataclasses
import re
from argparse import ArgumentParser
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from rover_parameters.records import ConfigError
from terrain_estimator.bags import Types
from terrain_estimator.discovery.runs import RecordedRun, RunError
from terrain_estimator.model.packing import view_of
from terrain_estimator.offline.bag_options import BagOptions, add_options, reading_of
from terrain_estimator.offline.finding_file import asked, soil_sums
from terrain_estimator.offline.reading_runs import read_run
from terrain_estimator.offline.run_soils import run_soils
from terrain_estimator.offline.topic_mapping import TopicError
from terramechanics.presets import load_soil
from tests.drives import ROVER, Event, drive_messages, write_bag

TYPES = Types()
SECONDS = 3.0
LATER_NS = 3_000_000


def reading(*options: str) -> BagOptions:
    parser = ArgumentParser()
    add_options(parser)
    return reading_of(parser.parse_args(options))


def of_another_rover() -> Iterator[Event]:
    """Return an odometry with late stamps, and a mast on joint_states before the wheels."""
    for topic, stamp_ns, message in drive_messages(TYPES.make, SECONDS):
        if topic == "odom":
            message.header.stamp.nanosec += LATER_NS
        if topic == "joint_states":
            still = dict.fromkeys(("position", "velocity", "effort"), np.zeros(1))
            yield (
                topic,
                stamp_ns,
                TYPES.make(
                    "sensor_msgs/msg/JointState", header=message.header, name=["mast_pan"], **still
                ),
            )
        yield topic, stamp_ns, message


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(
        tmp_path_factory.mktemp("plain") / "bag", drive_messages(TYPES.make, SECONDS), TYPES
    )


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("other") / "bag", of_another_rover(), TYPES, "/rover1")


def torque(run: RecordedRun) -> torch.Tensor:
    return view_of(run.packed, ROVER.axles).torque


def test_topics_and_stamps_of_another_rover_are_told_and_joints_of_a_mast_cost_nothing(
    plain: Path, other: Path
) -> None:
    expected = read_run(plain, ROVER, BagOptions())
    found = read_run(
        other, ROVER, reading("--namespace", "rover1", "-p", "pairing_tolerance:=0.02")
    )
    torch.testing.assert_close(found.packed, expected.packed, rtol=0.0, atol=0.0, equal_nan=True)
    assert torch.isfinite(torque(found)).all()


def test_sensors_that_the_estimator_leaves_out_are_left_out(plain: Path) -> None:
    run = read_run(
        plain,
        ROVER,
        reading("-p", "use_torque:=false", "-p", "use_moments:=false", "-p", "use_imu:=false"),
    )
    assert torch.isnan(torque(run)).all()
    view = view_of(run.packed, ROVER.axles)
    for values in (view.acceleration, view.acceleration_sd, view.bogie_angle):
        assert torch.isnan(values).all()


def test_a_run_without_a_usable_observation_says_what_was_refused_and_why(
    plain: Path, other: Path
) -> None:
    renamed = tuple(
        dataclasses.replace(wheel, name=f"{wheel.name}_wheel") for wheel in ROVER.wheels
    )
    with pytest.raises(
        RunError,
        match=(
            r"30 WRONG_WHEELS \(wheel_slip: got wheels .*front_left_wheel.*publish the wheel names"
        ),
    ):
        read_run(plain, dataclasses.replace(ROVER, wheels=renamed), BagOptions())
    with pytest.raises(RunError, match=r"30 STANDSTILL .*: drive: slip is undefined"):
        read_run(plain, ROVER, reading("-p", "standstill_speed:=1.0"))
    with pytest.raises(RunError, match=r"have stamps within the parameter pairing_tolerance, 0 s"):
        read_run(other, ROVER, reading("--namespace", "rover1"))
    with pytest.raises(TopicError, match=r"/rover1/odom.*: give --namespace or --remap"):
        read_run(other, ROVER, BagOptions())


def test_a_finding_says_with_which_topics_and_parameters_the_bags_were_read() -> None:
    told = asked(
        "my_rover",
        run_soils(["compact_sand"], [Path("monday")], ROVER, ["regolith"]),
        0,
        reading("--remap", "odom:=/inertial", "-p", "torque_noise.relative:=0.1"),
    )
    assert told == {
        "rover": "my_rover",
        "soil": "compact_sand",
        "seed": 0,
        "other_soils": ["regolith"],
        "topics": {"odom": "/inertial"},
        "parameters": {"torque_noise.relative": 0.1},
    }


def test_every_run_has_its_soil_or_that_of_all_others() -> None:
    runs = [Path("a/monday"), Path("b/tuesday"), Path("b/wednesday")]
    given = ["b/tuesday=regolith", "compact_sand", "monday=loose_sand"]
    found = run_soils(given, runs, ROVER)
    assert list(found.names.values()) == ["loose_sand", "regolith", "compact_sand"]
    assert [soil.name for soil in found.soils.values()] == list(found.names.values())
    assert asked("my_rover", found, 0, BagOptions())["soils"] == {
        "a/monday": "loose_sand",
        "b/tuesday": "regolith",
        "b/wednesday": "compact_sand",
    }
    sums = soil_sums(found)
    assert set(sums) == {"soil loose_sand", "soil regolith", "soil compact_sand"}
    assert len(set(sums.values())) == 3
    assert set(run_soils([], runs, ROVER).names.values()) == {"loose_sand"}


def test_soils_at_hand_are_those_told_and_others_that_carry_the_wheels(tmp_path: Path) -> None:
    told = dataclasses.asdict(load_soil("loose_sand"))

    def file(stem: str, **values: object) -> str:
        path = tmp_path / f"{stem}.yaml"
        path.write_text(yaml.safe_dump(told | values))
        return str(path)

    runs = [Path("monday"), Path("tuesday")]
    dust = file("dust", name="dust", n=0.9)
    found = run_soils([], runs, ROVER, ["regolith", dust, "loose_sand"])
    assert [soil.name for soil in found.at_hand] == ["loose_sand", "regolith", "dust"]
    assert set(soil_sums(found)) == {"soil", "other soil regolith", "other soil dust"}
    mine = run_soils([file("mine", n=0.8)], runs, ROVER, ["regolith", "loose_sand"])
    assert [(soil.name, soil.n) for soil in mine.at_hand] == [
        ("loose_sand", 0.8),
        ("regolith", 1.0),
    ]
    for other, words in (
        ("cheese", "cheese"),
        (file("soft", name="soft", k_c=-told["k_phi"]), "the soil would carry nothing"),
        (file("copy", n=0.7), "another soil here is called 'loose_sand', too"),
    ):
        with pytest.raises(ConfigError, match=words):
            run_soils([], runs, ROVER, [other])


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["sunday=regolith"], "--soil sunday=regolith: 'sunday' is no run of this call"),
        (["mondai=regolith"], "did you mean monday?"),
        (["monday=cheese"], "cheese"),
        (["regolith", "compact_sand"], "regolith is given for all runs already"),
        (["monday=regolith", "a/monday=compact_sand"], "run a/monday has the soil regolith"),
        (["hills=regolith"], "a/hills and b/hills have that name: give the path"),
    ],
)
def test_a_soil_of_an_unknown_run_and_an_unknown_soil_are_refused_by_name(
    given: list[str], words: str
) -> None:
    runs = [Path("a/monday"), Path("a/hills"), Path("b/hills")]
    with pytest.raises(ConfigError, match=re.escape(words)):
        run_soils(given, runs, ROVER)
