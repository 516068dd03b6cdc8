# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect with a model by wheel on bags of drives with turns."""

import json
from pathlib import Path

import pytest
import torch

from terrain_estimator.bags import BagWriter
from terrain_estimator.cli import find_missing_effect
from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.cli.model_by_wheel import main as model_by_wheel
from terrain_estimator.discovery.hypotheses.library import NOT_BY_WHEEL
from terrain_estimator.importing.mapping import (
    BodySignal,
    Mapping,
    SignalNoise,
    Time,
    WheelColumns,
    WheelSignal,
)
from terrain_estimator.importing.messages import SampleWriter
from terrain_estimator.importing.samples import MeasuredValue, TableSample
from terrain_estimator.learning.observing import observed
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.row_names import row_names_by_wheel
from terrain_estimator.observation import Observation
from terramechanics.vehicle.wheel_places import chassis_places, wheel_order
from tests.hidden.sealing import COLUMN, START_NS, STEP_NS
from tests.hidden.vehicle import DryBearing
from tests.turning_hidden import SKID, driven

DRIVES, SECONDS, TORQUE, SEED = 3, 20.0, 0.5, 95_000_001


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return bags of drives of a skid-steer whose drives have dry friction."""
    generator, rover = torch.Generator().manual_seed(SEED), SKID.rover
    hidden = DryBearing(torch.full((DRIVES,), TORQUE, dtype=torch.float64))
    samples, _, plant = driven(SKID, hidden, DRIVES, SECONDS, generator)
    order = [chassis_places(rover)[k] for k in wheel_order(rover)]
    folder = tmp_path_factory.mktemp("turning")
    found = []
    for number, drive in enumerate(observed(rover, samples, order, generator, plant), start=1):
        found.append(str(folder / f"run_{number}"))
        with BagWriter(found[-1]) as writer:
            SampleWriter(writer, mapping()).write_all(map(sample, range(len(drive)), drive))
    return found


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the model by wheel that model_by_wheel writes for the skid-steer."""
    folder, places = tmp_path_factory.mktemp("model"), SKID.places
    rover = ["--rover", SKID.rover.name, "--soil", "loose_sand", "--out", str(folder)]
    body = ["--track-width", str(places.track_width), "--yaw-inertia", str(places.yaw_inertia)]
    assert model_by_wheel([*rover, *body]) == 0
    return str(folder / f"{SKID.rover.name}_by_wheel.pt")


def mapping() -> Mapping:
    """Return what is measured; names of columns and deviations are required but unused."""
    some = SignalNoise(absolute=1.0)
    return Mapping(
        time=Time(COLUMN),
        wheels=tuple(
            WheelColumns(wheel, COLUMN, COLUMN, COLUMN, COLUMN, COLUMN)
            for wheel in SKID.places.wheels(SKID.rover)
        ),
        slip=WheelSignal("1", some),
        sinkage=WheelSignal("m", some),
        contact_angle=WheelSignal("rad", some),
        wheel_rate=WheelSignal("rad/s"),
        torque=WheelSignal("N m"),
        velocity=BodySignal(COLUMN, "m/s", some),
        pitch=BodySignal(COLUMN, "rad", some, positive="nose_up"),
        acceleration=BodySignal(COLUMN, "m/s^2", some),
        roll=BodySignal(COLUMN, "rad"),
        lateral_velocity=BodySignal(COLUMN, "m/s", some),
        yaw_rate=BodySignal(COLUMN, "rad/s", some),
    )


def sample(step: int, one: Observation) -> TableSample:
    """Return an observation by wheel as the writer of bags takes it."""

    def body(name: str) -> MeasuredValue:
        return MeasuredValue(getattr(one, name), getattr(one, f"{name}_sd"))

    def wheels(name: str) -> list[MeasuredValue]:
        values, deviations = getattr(one, name), getattr(one, f"{name}_sd")
        return list(map(MeasuredValue, values.tolist(), deviations.tolist()))

    return TableSample(
        stamp_ns=START_NS + step * STEP_NS,
        slip=wheels("slip"),
        sinkage=wheels("sinkage"),
        contact_angle=wheels("contact_angle"),
        wheel_rate=one.wheel_rate.tolist(),
        torque=one.torque.tolist(),
        velocity=body("velocity"),
        pitch=body("pitch"),
        acceleration=body("acceleration"),
        bogie_angle=one.bogie_angle,
        roll=one.roll,
        lateral_velocity=body("lateral_velocity"),
        yaw_rate=body("yaw_rate"),
    )


def test_a_hidden_effect_of_turning_drives_is_named_and_written_to_a_model_by_wheel(
    bags: list[str], model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--rover", SKID.rover.name, "--model", model, "--soil", "loose_sand"]
    out, library = ["--out", str(tmp_path)], ["--library", "coulomb_drag,slope_bias"]
    assert main([*bags[:2], "--hold-out", bags[2], *options, *library, *out]) == 0
    finding = json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))
    assert finding["verdict"] == "named"
    assert [each["name"] for each in finding["effects"]] == ["coulomb_drag"]
    assert finding["effects"][0]["coefficient"] > 0.0
    assert (finding["runs"], finding["held_out"]) == (["run_1", "run_2"], ["run_3"])
    assert finding["proof"]["added"]
    assert finding["proof"]["gap"] is None
    assert finding["proof"]["one_step_gap"]["after"] < finding["proof"]["one_step_gap"]["before"]
    assert {each["row"] for each in finding["where"]} <= set(row_names_by_wheel(4, 0))
    assert finding["isolability"]["not_testable"].keys() >= NOT_BY_WHEEL.keys()
    assert (finding["next_drives"], finding["missing_signals"]) == ([], [])
    assert "<h1>The model lacks coulomb_drag</h1>" in (tmp_path / "report.html").read_text(
        encoding="utf-8"
    )
    extended = load_model(str(tmp_path / "model.pt"))
    assert [each.name for each in extended.effects] == ["coulomb_drag"]
    assert extended.metadata.wheel_places == SKID.places
    assert "predictions of one second miss by" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (["--library", "multipass"], "effect multipass is not testable by wheel"),
        (["--other-soils", "regolith"], "by wheel no other soil is weighed: leave it out"),
        (["--rover-sd", "mass=1"], "by wheel the rover's constants count as exact: leave it out"),
        (["-p", "use_sinkage:=false"], "parameter use_sinkage: the search needs every sinkage"),
    ],
)
def test_what_a_search_by_wheel_cannot_do_is_refused_with_advice(
    bags: list[str],
    model: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    extra: list[str],
    said: str,
) -> None:
    monkeypatch.setattr(find_missing_effect, "Study", None)  # is said before
    options = ["--rover", SKID.rover.name, "--model", model, "--out", str(tmp_path / "out")]
    assert main([*bags[:2], *options, *extra]) == 2
    assert said in capsys.readouterr().err
