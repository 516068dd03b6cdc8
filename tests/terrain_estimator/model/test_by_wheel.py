# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A model by wheel: its rows hold for a rover that turns, and the estimator learns in turns."""

import dataclasses
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from rover_sim_node.config import FOLLOW, SimulatorConfig
from rover_sim_node.turning_run import TurningRun
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig, EstimatorConfig
from terrain_estimator.estimator.configured import as_configured
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.off_plane import SingleWheels
from terrain_estimator.learning.adding import Sized, add_effects, with_effects
from terrain_estimator.learning.by_wheel import build_model_by_wheel
from terrain_estimator.learning.export import export
from terrain_estimator.learning.restore import restore
from terrain_estimator.messaging.averaging import Averager, averaged
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.pipeline import warm_up
from terrain_estimator.model.block import BlockRows
from terrain_estimator.model.effects import not_estimated
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import ModelFileError, Training
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packed_observation import TurningBody, pack, unpacked
from terrain_estimator.model.row_names import row_names_by_wheel
from terrain_estimator.observation import Observation
from terrain_estimator.offline.estimation_process import _pack, _unpack
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Update
from terramechanics.effects import EFFECTS
from terramechanics.presets import load_rover, load_soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces
from tests.rovers import BOGIE_IN_FRONT, rover_file
from tests.turning_drives import Twist, turning_observations

LOOSE = load_soil("loose_sand")
TRACK = {"four_wheel_rover": 0.57, "mars_rover": 1.0, BOGIE_IN_FRONT.name: 1.0}
SKID: tuple[Twist, ...] = ((0.2, 0.0), (0.25, 0.4), (0.2, 0.0), (0.25, -0.4))
STEERED: tuple[Twist, ...] = ((0.08, 0.0), (0.1, 0.04), (0.08, 0.0), (0.1, -0.04))


def places_of(rover: Rover, *, steered: bool) -> WheelPlaces:
    return WheelPlaces.of(rover, TRACK[rover.name], rover.wheel_names if steered else ())


def written(
    rover: Rover, places: WheelPlaces, path: Path, torque_sd: tuple[float, ...] = ()
) -> LoadedModel:
    model = build_model_by_wheel(rover, places, [LOOSE], torque_sd=torque_sd)
    export(model, rover, [LOOSE], Training(0, 0, 0.0, torch.__version__), path, places)
    return load_model(str(path))


@pytest.fixture(scope="module")
def skid(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    rover = load_rover("four_wheel_rover")
    path = tmp_path_factory.mktemp("skid") / "skid.pt"
    return written(rover, places_of(rover, steered=False), path)


@pytest.fixture(scope="module")
def steered(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    rover = load_rover("mars_rover")
    path = tmp_path_factory.mktemp("steered") / "steered.pt"
    return written(rover, places_of(rover, steered=True), path)


@pytest.fixture(scope="module")
def in_front(tmp_path_factory: pytest.TempPathFactory) -> LoadedModel:
    path = tmp_path_factory.mktemp("in_front") / "in_front.pt"
    return written(BOGIE_IN_FRONT, places_of(BOGIE_IN_FRONT, steered=True), path)


def observations(
    model: LoadedModel,
    twists: Sequence[Twist],
    seconds: float,
    *,
    noise: float = 1.0,
    seed: int = 0,
    lean: float = 0.0,
    shift: tuple[float, float] = (0.0, 0.0),
    profile: str = "",
    mass: float = 0.0,
) -> list[Observation]:
    """Return what the node makes of the messages of a drive, with ``seconds`` for each twist.

    ``lean`` [rad] is the slope across, ``shift`` [m] how far the centre of mass is ahead and to the
    left of where the rover file has it, ``mass`` [1] by which share it is heavier.
    """
    name = model.rover.name
    config = SimulatorConfig(
        steering="all_wheels" if any(model.metadata.steered) else "skid",
        schedule=FOLLOW,
        track_width=TRACK[name],
        noise=noise,
        seed=seed,
        cross_slope=lean,
        profile=profile,
    )
    with tempfile.TemporaryDirectory() as folder:
        path = rover_file(model.rover, Path(folder, "rover.yaml"))
        run = TurningRun(dataclasses.replace(config, rover=path))
    chassis = run._simulation.chassis
    x, y, height = chassis.centre
    moved = (x + shift[0], y + shift[1], height)
    run._simulation.chassis = dataclasses.replace(
        chassis, centre=moved, mass=(1.0 + mass) * chassis.mass
    )
    # the simulator has its sensors where the rover file has the centre of mass
    return [
        dataclasses.replace(
            one,
            lateral_velocity=one.lateral_velocity - shift[0] * one.yaw_rate,
            velocity=one.velocity + shift[1] * one.yaw_rate,
        )
        for one in turning_observations(model, run, twists, seconds)
    ]


def driven(model: LoadedModel, observed: Sequence[Observation]) -> list[Update]:
    estimator = Estimator(model, CoreConfig())
    return [estimator.update(each) for each in observed]


def packed(model: LoadedModel, observed: Sequence[Observation]) -> Tensor:
    rover = model.rover
    body = TurningBody(rover.wheel_radius, rover.gravity, rover.centre_of_mass_x)
    rows = [pack(each, each.torque.tolist(), 0.1, linked=True, body=body) for each in observed]
    return torch.from_numpy(np.array(rows))


def exact(observed: Observation) -> Observation:
    """Return the observation with deviations that let rows be expanded where they were measured."""
    tiny = {f"{name}_sd": np.full_like(observed.slip, 1e-6) for name in ("slip", "contact_angle")}
    tiny["sinkage_sd"] = np.full_like(observed.slip, 1e-9)
    still = {"lateral_velocity_sd": 1e-6, "yaw_rate_sd": 1e-6, "pitch_sd": 1e-6, "roll_sd": 1e-6}
    return dataclasses.replace(observed, **tiny, **still)  # type: ignore[arg-type]


def block_at_truth(
    model: LoadedModel, found: list[Observation]
) -> tuple[BlockRows, Tensor, dict[str, int]]:
    """Return the rows of the last second at the truth, what they miss [Q], and their places."""
    places = places_of(model.rover, steered=any(model.metadata.steered))
    twin = build_model_by_wheel(model.rover, places, [LOOSE])
    block = packed(model, [exact(each) for each in found[-10:]])
    expansion = torch.zeros(2 + twin.layout.constants, dtype=torch.float64)
    expansion[:2] = torch.tensor([LOOSE.cohesion / 1e3, LOOSE.tan_phi])
    rows = twin.physics.average(block, twin.learnt(block), 0, expansion, twin.every_row).rows
    short = rows.target - rows.offset - rows.linear[:, :2] @ expansion[:2]
    names = row_names_by_wheel(len(model.rover.wheels), len(model.rover.suspension))
    return rows, short, {name: place for place, name in enumerate(names, 1)}


@pytest.mark.parametrize(
    ("name", "turn"),
    [
        ("skid", (0.25, 0.4)),
        ("steered", (0.08, 0.04)),
        ("skid", (-0.2, -0.2)),
        ("in_front", (0.08, 0.04)),
        ("in_front", (-0.08, 0.04)),
    ],
)
def test_all_rows_hold_at_the_truth_in_a_steady_turn(
    name: str, turn: Twist, request: pytest.FixtureRequest
) -> None:
    model: LoadedModel = request.getfixturevalue(name)
    rows, short, place = block_at_truth(model, observations(model, [turn], 8.0, noise=0.0))
    assert not rows.present.eq(0.0).any()
    # the velocity does not change: its row is the acceleration over the block, in m/s
    largest = {"lateral_velocity": 2e-3, "yaw_rate": 1e-5}
    for row, at in place.items():
        assert abs(float(short[at])) < largest.get(row, 1e-3), row


@pytest.mark.parametrize("turn", [(0.25, 0.0), (0.25, 0.3)])
def test_a_shifted_centre_of_mass_is_what_its_parameters_say(
    skid: LoadedModel, turn: Twist
) -> None:
    shift = (0.02, -0.015)
    found = observations(skid, [turn], 8.0, noise=0.0, lean=0.2, shift=shift)
    rows, short, place = block_at_truth(skid, found)
    names = skid.metadata.parameters
    ahead, aside = (
        rows.linear[:, names.index(name)] for name in ("centre_of_mass", "centre_of_mass_y")
    )
    left = short - ahead * shift[0] - aside * shift[1]
    for row in ("moment", "roll_moment", "yaw_rate"):
        at = place[row]
        assert abs(float(short[at])) > 1e-3, row
        assert abs(float(left[at])) < 0.05 * abs(float(short[at])), row


@pytest.mark.parametrize("turn", [(0.25, 0.0), (0.25, 0.4)])
def test_more_mass_is_what_its_parameter_says(skid: LoadedModel, turn: Twist) -> None:
    found = observations(skid, [turn], 8.0, noise=0.0, lean=0.2, mass=0.05)
    rows, short, place = block_at_truth(skid, found)
    left = short - rows.linear[:, skid.metadata.parameters.index("mass")] * 0.05
    for row in ("load", "velocity", "acceleration", "lateral_velocity"):
        at = place[row]
        assert abs(float(short[at])) > 1e-2, row
        share = 0.15 if row == "velocity" else 0.05  # what the speed changes by is not in it
        assert abs(float(left[at])) < share * abs(float(short[at])), row


def rolled(found: Sequence[Observation], bias: float) -> list[Observation]:
    """Return the observations with a roll that is read too large by ``bias`` [rad]."""
    return [dataclasses.replace(each, roll=each.roll + bias) for each in found]


def test_a_constant_error_of_the_roll_is_what_its_parameter_says(skid: LoadedModel) -> None:
    found = rolled(observations(skid, [(0.25, 0.3)], 8.0, noise=0.0, lean=0.2), 0.01)
    rows, short, place = block_at_truth(skid, found)
    left = short - 0.01 * rows.linear[:, skid.metadata.parameters.index("roll_bias")]
    at = place["lateral_velocity"]
    assert abs(float(short[at])) > 0.09
    assert abs(float(left[at])) < 0.05 * abs(float(short[at]))
    others = [k for k in range(len(short)) if k != at]
    assert torch.equal(left[others], short[others])


def test_a_constant_error_of_the_roll_is_in_the_intervals_across_a_slope(
    skid: LoadedModel,
) -> None:
    """4 drives of 40 s: with 95 % intervals 3 or more misses of 8 have a probability of 0.6 %."""
    truth, held = np.array([LOOSE.cohesion, LOOSE.tan_phi]), []
    for seed in range(4):
        bias = math.radians(0.7 if seed % 2 else -0.7)
        found = rolled(observations(skid, [(0.25, 0.0)], 40.0, seed=seed, lean=0.2), bias)
        estimate = driven(skid, found)[-1].estimate
        held += ((estimate.lower_95 <= truth) & (truth <= estimate.upper_95)).tolist()
    assert sum(held) >= 6


def test_a_gain_and_friction_of_the_torques_are_estimated(
    skid: LoadedModel, tmp_path: Path
) -> None:
    """Motors that read a fifth too much, and 0.4 N m of friction; 2 drives of 32 s.

    4 intervals of 95 % miss twice or more with a probability of 1.4 %. The model that takes the
    torques to be right misses by far, or says that it does not fit.
    """
    places = places_of(skid.rover, steered=False)
    model = written(skid.rover, places, tmp_path / "gain.pt", (0.15, 0.3))
    truth, held, fooled = np.array([LOOSE.cohesion, LOOSE.tan_phi]), [], []
    for seed in range(2):
        found = [
            dataclasses.replace(each, torque=1.2 * each.torque + 0.4 * np.sign(each.wheel_rate))
            for each in observations(skid, SKID, 8.0, seed=seed)
        ]
        updates = driven(model, found)
        estimate = updates[-1].estimate
        held += ((estimate.lower_95 <= truth) & (truth <= estimate.upper_95)).tolist()
        assert np.sqrt(np.diag(estimate.covariance))[1] < 0.06
        assert not updates[-1].disagreements
        plain = driven(skid, found)[-1]
        miss = np.abs(plain.estimate.mean - truth) / np.sqrt(np.diag(plain.estimate.covariance))
        fooled.append(bool(plain.disagreements) or miss.max() > 3.0)
    assert sum(held) >= 3
    assert all(fooled)


def test_every_row_is_used(skid: LoadedModel) -> None:
    updates = driven(skid, observations(skid, [(0.25, 0.0)], 1.0))
    assert updates[-1].decision.rows_used == skid.rows


@pytest.mark.parametrize(("name", "twists"), [("skid", SKID), ("steered", STEERED)])
def test_intervals_hold_in_turns_of_which_nothing_is_refused(
    name: str, twists: tuple[Twist, ...], request: pytest.FixtureRequest
) -> None:
    """3 drives of 32 s over hills: of 6 intervals of 95 % two miss with a probability of 3 %."""
    model: LoadedModel = request.getfixturevalue(name)
    truth, held = np.array([LOOSE.cohesion, LOOSE.tan_phi]), []
    for seed in range(3):
        updates = driven(model, observations(model, twists, 8.0, seed=seed, profile="hills"))
        refused = [each.decision.detail for each in updates if not each.decision.outcome.used]
        assert not refused
        estimate = updates[-1].estimate
        held += ((estimate.lower_95 <= truth) & (truth <= estimate.upper_95)).tolist()
        deviation = np.sqrt(np.diag(estimate.covariance))
        assert deviation[0] < 500.0
        assert deviation[1] < 0.06
        assert not updates[-1].disagreements
    assert sum(held) >= 5


def test_a_turn_tells_more_than_driving_straight(skid: LoadedModel) -> None:
    deviations = []
    for twists in ([(0.25, 0.0)], [(0.25, 0.4)]):
        estimate = driven(skid, observations(skid, twists, 20.0))[-1].estimate
        deviations.append(np.sqrt(np.diag(estimate.covariance)))
    assert (deviations[1] < deviations[0]).all()
    assert deviations[1][0] < 0.85 * deviations[0][0]


def test_backing_out_is_used(skid: LoadedModel) -> None:
    updates = driven(skid, observations(skid, [(-0.2, 0.1)], 15.0))
    assert all(each.decision.outcome.used for each in updates)
    estimate = updates[-1].estimate
    truth = np.array([LOOSE.cohesion, LOOSE.tan_phi])
    assert ((estimate.lower_95 <= truth) & (truth <= estimate.upper_95)).all()
    assert estimate.seconds.taken > 10


REFUSED: tuple[tuple[dict[str, object], Outcome, str], ...] = (
    ({"yaw_rate": math.nan}, Outcome.NOT_FINITE, "yaw rate is nan, which a model by wheel needs"),
    ({"roll": math.nan}, Outcome.NOT_FINITE, "roll is nan"),
    ({"roll": 0.7}, Outcome.OUT_OF_RANGE, "roll 0.7 is not within +-0.5"),
    ({"lateral_velocity_sd": 0.0}, Outcome.BAD_DEVIATION, "of lateral velocity is 0"),
    ({"roll_sd": -1.0}, Outcome.BAD_DEVIATION, "of roll is -1"),
    ({"wheel_rate": np.array([1.0, math.nan, 1.0, 1.0])}, Outcome.NOT_FINITE, "front_right: wheel"),
    ({"steering": np.array([0.0, 0.0, 1.2, 0.0])}, Outcome.OUT_OF_RANGE, "rear_left: steering 1.2"),
    ({"steering": np.full(4, math.nan)}, Outcome.NOT_FINITE, "front_left: steering is nan"),
    ({"lateral_velocity": 1.3, "yaw_rate": 9.0}, Outcome.OUT_OF_RANGE, "is beyond 0.2 g"),
    ({"wheel_rate": np.array([1.0, 0.0, 1.0, 1.0])}, Outcome.OUT_OF_RANGE, "right: it stands"),
    ({"slip": np.array([3.5, 0.1, 0.1, 0.1])}, Outcome.OUT_OF_RANGE, "wheel front_left: slip 3.5"),
)


@pytest.mark.parametrize(("changes", "outcome", "words"), REFUSED)
def test_what_does_not_tell_how_a_wheel_moves_is_refused_by_name(
    skid: LoadedModel, changes: dict[str, object], outcome: Outcome, words: str
) -> None:
    estimator = Estimator(skid, CoreConfig())
    good = observations(skid, [(0.25, 0.1)], 1.0)
    for each in good[:-1]:
        estimator.update(each)
    update = estimator.update(dataclasses.replace(good[-1], **changes))  # type: ignore[arg-type]
    assert update.decision.outcome is outcome
    assert words in update.decision.detail
    after = dataclasses.replace(good[-1], stamp_ns=good[-1].stamp_ns + 100_000_000)
    assert estimator.update(after).decision.outcome.used


@pytest.mark.parametrize(("name", "twists"), [("skid", [(0.15, 0.6)] * 3), ("steered", STEERED)])
def test_a_saved_state_goes_on_with_the_same_bytes(
    name: str, twists: Sequence[Twist], request: pytest.FixtureRequest
) -> None:
    model: LoadedModel = request.getfixturevalue(name)
    found = observations(model, twists, 4.0)
    first, second = Estimator(model, CoreConfig()), Estimator(model, CoreConfig())
    for each in found[:87]:
        first.update(each)
    second.restore(first.save())
    for each in found[87:-1]:
        first.update(each)
        second.update(each)
    one, other = first.update(found[-1]), second.update(found[-1])
    assert one.estimate.mean.tobytes() == other.estimate.mean.tobytes()
    assert one.estimate.covariance.tobytes() == other.estimate.covariance.tobytes()


def test_fast_readings_are_averaged_with_their_steering(steered: LoadedModel) -> None:
    config = EstimatorConfig()
    core = config.core.of_model(by_wheel=True)
    averager = Averager(steered.rover, core, SingleWheels.of(steered.metadata))
    readings = observations(steered, [(0.1, 0.04)], 3.0)
    spread = [
        dataclasses.replace(each, stamp_ns=readings[0].stamp_ns + step * 20_000_000)
        for step, each in enumerate(readings)
    ]
    conversions = (Conversion(each.stamp_ns, each) for each in spread)
    *_, last = (each.observation for each in averaged(conversions, averager))
    assert last is not None
    assert last.steering is not None
    own = [each for each in spread if 0 <= last.stamp_ns - each.stamp_ns < 100_000_000]
    assert len(own) == 5
    expected = np.mean([each.steering for each in own if each.steering is not None], axis=0)
    np.testing.assert_allclose(last.steering, expected, rtol=1e-12)
    np.testing.assert_allclose(last.yaw_rate_sd, own[0].yaw_rate_sd / math.sqrt(5.0), rtol=1e-12)


def test_a_missing_contact_angle_is_supposed_along_the_wheels_own_bogie(
    steered: LoadedModel,
) -> None:
    given = observations(steered, [(0.1, 0.04)], 1.0)[-1]
    given = dataclasses.replace(given, contact_angle=np.full(6, math.nan), bogie_angle=0.05)
    found = as_configured(given, steered.rover, CoreConfig(contact_angle_sd=0.03))
    assert found.contact_angle.tolist() == [0.0, 0.0, 0.05, 0.05, 0.05, 0.05]
    assert found.contact_angle_sd.tolist() == [0.03] * 6
    assert Estimator(steered, CoreConfig(contact_angle_sd=0.03)).update(given).decision.outcome.used


def test_steering_reaches_an_estimator_in_another_process(steered: LoadedModel) -> None:
    found = observations(steered, [(0.1, 0.04)], 1.0)
    refused = Conversion(5, None, Outcome.WRONG_FRAME, "none")
    given = [refused, *(Conversion(each.stamp_ns, each) for each in found)]
    first, *others = _unpack(_pack(list(given)))
    assert first == refused
    for one, other in zip(found, others, strict=True):
        assert other.observation is not None
        np.testing.assert_array_equal(other.observation.steering, one.steering)
        np.testing.assert_array_equal(other.observation.torque_sd, one.torque_sd)
        assert other.observation.yaw_rate == one.yaw_rate


def test_steered_wheels_without_their_angles_are_refused(steered: LoadedModel) -> None:
    given = dataclasses.replace(observations(steered, [(0.1, 0.04)], 1.0)[-1], steering=None)
    decision = Estimator(steered, CoreConfig()).update(given).decision
    assert decision.outcome is Outcome.NOT_FINITE
    assert "wheel front_left: steering is nan" in decision.detail


def test_a_velocity_to_the_side_without_a_variance_is_not_supposed() -> None:
    own = ConversionConfig().of_model(by_wheel=True)
    assert (own.default_lateral_velocity_sd, own.default_yaw_rate_sd) == (0.0, 0.0)
    told = ConversionConfig(default_lateral_velocity_sd=0.02).of_model(by_wheel=True)
    assert told.default_lateral_velocity_sd == 0.02
    assert ConversionConfig().of_model(by_wheel=False) == ConversionConfig()


def test_a_rover_file_with_a_wheel_on_the_other_side_differs(skid: LoadedModel) -> None:
    rover = skid.rover
    sides = {"left": "right", "right": "left"}
    wheels = tuple(dataclasses.replace(each, side=sides[each.side]) for each in rover.wheels)
    swapped = dataclasses.replace(rover, wheels=wheels)
    assert swapped.first_difference(rover) is None
    assert swapped.other_side(rover) == ("side of wheel front_left", "right", "left")
    assert rover.other_side(rover) is None


@pytest.mark.parametrize("name", ["skid", "steered"])
def test_the_warm_up_runs_the_model(
    name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcomes, update = [], Estimator.update

    def noted(self: Estimator, observation: Observation) -> Update:
        found = update(self, observation)
        outcomes.append(found.decision.outcome)
        return found

    monkeypatch.setattr(Estimator, "update", noted)
    warm_up(request.getfixturevalue(name), EstimatorConfig())
    assert Outcome.ACCEPTED in outcomes


def test_an_observation_is_unpacked_as_it_was_packed(steered: LoadedModel) -> None:
    given = observations(steered, [(0.1, 0.04)], 1.0)[-1]
    found, step, linked = unpacked(packed(steered, [given])[0].numpy(), 6)
    assert (step, linked) == (0.1, 1.0)
    np.testing.assert_array_equal(found.slip, given.slip)
    np.testing.assert_array_equal(found.steering, given.steering)
    np.testing.assert_allclose(found.wheel_rate, steered.rover.wheel_radius * given.wheel_rate)
    assert (found.yaw_rate, found.roll) == (given.yaw_rate, given.roll)


def test_gravity_and_the_turn_pull_together_on_the_packed_pitch() -> None:
    body = TurningBody(0.2, 9.81, 0.1)
    nothing = np.zeros(1)
    flat = Observation(
        stamp_ns=0,
        slip=nothing,
        slip_sd=nothing,
        sinkage=nothing,
        sinkage_sd=nothing,
        contact_angle=nothing,
        contact_angle_sd=nothing,
        wheel_rate=nothing,
        torque=nothing,
        torque_sd=nothing,
        velocity=0.2,
        velocity_sd=0.01,
        pitch=0.05,
        pitch_sd=0.01,
        acceleration=0.0,
        acceleration_sd=0.1,
        lateral_velocity=0.3,
        yaw_rate=0.5,
    )
    pulled = 9.81 * math.sin(0.05) - 0.5 * (0.3 + 0.1 * 0.5)
    assert math.sin(body.pitch(flat)) == pytest.approx(pulled / 9.81, rel=1e-12)


def test_every_effect_of_models_by_wheel_is_written_and_estimated(
    skid: LoadedModel, tmp_path: Path
) -> None:
    names = [name for name in EFFECTS if name not in not_estimated(by_wheel=True)]
    assert "lateral_bulldozing" in names
    effects = [Sized.of_library(name) for name in names]
    add_effects(skid, effects, tmp_path / "all.pt")
    updates = driven(load_model(str(tmp_path / "all.pt")), observations(skid, SKID, 1.0))
    for effect, prior in zip(updates[-1].estimate.effects, effects, strict=True):
        assert effect.name == prior.name
        assert 0.0 < effect.sd < prior.sd


def test_what_needs_a_model_by_axle_refuses_one_by_wheel(skid: LoadedModel) -> None:
    for name in ("payload", "multipass"):
        with pytest.raises(ConfigError, match=f"{name} cannot be added to a model by wheel"):
            with_effects(skid, [Sized.of_library(name)])
    with pytest.raises(ModelFileError, match="is by wheel: give one that is by axle"):
        restore(skid)
    with pytest.raises(ConfigError, match=r"knows law wong_reece alone, not scm"):
        build_model_by_wheel(
            skid.rover,
            places_of(skid.rover, steered=False),
            [dataclasses.replace(LOOSE, law="scm", c2=0.0)],
        )


def test_a_model_by_wheel_needs_torques(skid: LoadedModel) -> None:
    with pytest.raises(ConfigError, match=r"use_torque: model skid.* is by wheel.*set it to true"):
        Estimator(skid, CoreConfig(use_torque=False))
    estimator = Estimator(skid, CoreConfig())
    nothing = np.full(4, math.nan)
    updates = [
        estimator.update(dataclasses.replace(each, torque=nothing, torque_sd=nothing))
        for each in observations(skid, SKID, 5.0)
    ]
    last = updates[-1]
    assert last.unconfirmed == "without torques nothing tells c from tan phi in a model by wheel"
    assert last.estimate.identified == (False, False)
