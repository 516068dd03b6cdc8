# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a managed node are set over DDS, and take effect when it is configured."""

from dataclasses import replace

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from msg_defs.msg import EstimatorHealth
from rover_parameters.parameters import configure
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.pipeline import configuration_sha256
from terrain_estimator.model.model_file import load_model
from tests.live import live_pipeline
from tests.system.listening import Listener
from tests.system.processes import Starter

PRIOR = {"prior.cohesion_mean": 900.0, "prior.cohesion_sd": 100.0}


def put(listener: Listener, name: str, value: object) -> str:
    """Set a parameter of the estimator; return why it was refused, empty where it was not."""
    message = Parameter(name, value=value).to_parameter_msg()
    request = SetParameters.Request(parameters=[message])
    [result] = listener.call(SetParameters, "estimator/set_parameters", request).results
    assert result.successful == (not result.reason)
    return str(result.reason)


def change(listener: Listener, *transitions: int) -> list[bool]:
    return [
        listener.call(
            ChangeState,
            "estimator/change_state",
            ChangeState.Request(transition=Transition(id=each)),
        ).success
        for each in transitions
    ]


def test_all_are_read_at_configure_and_the_gate_at_any_time(
    start: Starter, listener: Listener
) -> None:
    health = listener.collect(EstimatorHealth, "estimator_health")
    estimator = start("terrain_estimator", "estimator")
    estimator.wait_for_output("ready: model", timeout=60.0)
    live, model = live_pipeline(), load_model()
    config = EstimatorConfig(runtime=live.runtime)

    def reported(expected: EstimatorConfig) -> None:
        sha256 = configuration_sha256(model, expected)
        listener.spin_until(
            lambda: health and health[-1].configuration_sha256 == sha256, "the values are in force"
        )

    reported(config)
    assert "the node is active: deactivate it" in put(listener, "use_torque", value=False)
    assert "out of range" in put(listener, "gate_probability", 0.5)
    assert "Type" in put(listener, "gate_probability", "none")
    assert "read-only" in put(listener, "auto_start", value=False)
    assert put(listener, "gate_probability", 0.01) == ""
    gated = replace(config, core=replace(config.core, gate_probability=0.01))
    reported(gated)

    assert change(listener, Transition.TRANSITION_DEACTIVATE) == [True]
    assert put(listener, "prior.cohesion_mean", PRIOR["prior.cohesion_mean"]) == ""
    estimator.wait_for_output("as soon as the node is configured: prior.cohesion_mean = 900")
    again = (Transition.TRANSITION_CLEANUP, Transition.TRANSITION_CONFIGURE)
    assert change(listener, *again) == [True, False]
    estimator.wait_for_output("has no effect without prior.cohesion_sd.*stays unconfigured")
    assert put(listener, "prior.cohesion_sd", PRIOR["prior.cohesion_sd"]) == ""
    last = (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
    assert change(listener, *last) == [True, True]
    reported(
        configure(EstimatorConfig, {**PRIOR, "gate_probability": 0.01, "runtime": live.runtime})
    )
    assert estimator.interrupt() == 0
