# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A skid-steer turns, the estimator learns from it by a model by wheel, and the replay agrees."""

from pathlib import Path

from geometry_msgs.msg import Twist, Vector3

from msg_defs.msg import MeasurementDecision, TerrainEstimate
from terrain_estimator.cli.model_by_wheel import main as model_by_wheel
from tests.system.listening import Listener
from tests.system.processes import Starter

TRACK = "0.57"


def test_turns_are_used_live_and_the_replay_gives_the_same_bytes(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    options = ["--rover", "four_wheel_rover", "--soil", "loose_sand", "--track-width", TRACK]
    assert model_by_wheel([*options, "--out", str(tmp_path)]) == 0
    model, bag = tmp_path / "four_wheel_rover_by_wheel.pt", tmp_path / "bag"
    estimator = start("terrain_estimator", "estimator", "--ros-args", "-p", f"model:={model}")
    recorder = start("terrain_estimator", "recorder", "--ros-args", "-p", f"output:={bag}")
    estimator.wait_for_output("ready: model four_wheel_rover_by_wheel", timeout=60.0)
    assert "leave the ground to the prior" not in estimator.output
    noisy = [f"default_sd.{each}:=5.0" for each in ("velocity", "lateral_velocity", "yaw_rate")]
    poor = [f"model:={model}", *noisy, "default_sd.pitch:=1.0", "torque_noise.absolute:=1e4"]
    poor += ["use_moments:=false", "use_imu:=false"]
    refused = start(
        "terrain_estimator", "estimator", "--ros-args", "-r", "__node:=poor",
        *(part for each in poor for part in ("-p", each)),
    )  # fmt: skip
    refused.wait_for_output("these sensors leave the ground to the prior", timeout=60.0)
    assert "default_sd.yaw_rate: 5" in refused.output
    assert "ready" not in refused.output
    assert refused.interrupt() == 0
    estimates = listener.collect(TerrainEstimate, "terrain_estimate")
    given = (
        "rover:=four_wheel_rover",
        "soil:=loose_sand",
        "steering:=skid",
        "profile:=hills",
        f"track_width:={TRACK}",
        "schedule:=cmd_vel",
        "duration:=16.0",
        "wait_for_subscribers:=2",
    )
    parameters = [part for each in given for part in ("-p", each)]
    simulator = start("rover_sim_node", "simulator", "--ros-args", *parameters)
    driver = listener.publisher(Twist, "cmd_vel")

    def turning() -> bool:
        driver.publish(Twist(linear=Vector3(x=0.2), angular=Vector3(z=0.4)))
        return len(estimates) >= 150

    listener.spin_until(turning, "150 estimates", seen=lambda: len(estimates), timeout=60.0)
    assert simulator.wait(60.0) == 0
    assert recorder.interrupt() == 0
    assert estimator.interrupt() == 0
    decisions = [each.decision.outcome for each in estimates[20:150]]
    assert decisions.count(MeasurementDecision.NOT_PLANAR) == 0
    assert decisions.count(MeasurementDecision.ACCEPTED) > 120
    assert estimates[149].covariance[0] < 0.5 * estimates[0].covariance[0]
    replayed = start(
        "terrain_estimator", "replay", str(bag), "--model", str(model), "--compare",
        "--out", str(tmp_path / "replayed"),
    )  # fmt: skip
    assert replayed.wait(120.0) == 0, replayed.output
    assert "terrain_estimate is identical to live" in replayed.output
