# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run the planner as a node: measurements and estimates in, advice out."""

import sys
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from rover_parameters.command_line import run
from terrain_estimator.config.planner import PlannerConfig
from terrain_estimator.nodes.common.declare import declare
from terrain_estimator.nodes.common.inactivity import InactivityMonitor, PairingMonitor
from terrain_estimator.nodes.common.message_types import make, message_class
from terrain_estimator.nodes.common.qos import subscribe
from terrain_estimator.nodes.common.running import LOG_PERIOD_S, guarded, serve
from terrain_estimator.nodes.common.traction import read_traction
from terrain_estimator.planning.inputs import PlannerInputs
from terrain_estimator.planning.messages import advice_message, belief_of_message
from terrain_estimator.planning.planner import Planner
from terrain_estimator.topics import (
    ADVICE,
    ESTIMATE,
    INPUT_TYPES,
    LISTENED,
    REQUIRED_INPUTS,
    Message,
    stamp_ns,
)

QOS = QoSProfile(depth=50)  # reliable, volatile, keep last


class PlannerNode(Node):
    """Publish advice once a period of the estimates' stamps."""

    def __init__(self, **options: Any) -> None:
        """Read parameters and model, get the statics, then subscribe; ``options`` are rclpy's.

        Raises:
            ConfigError: a parameter is unknown or wrong, or the model file is missing, damaged or
                for another rover.
        """
        super().__init__("planner", automatically_declare_parameters_from_overrides=True, **options)
        config = declare(self, PlannerConfig, INPUT_TYPES, arguments=options.get("cli_args"))
        model, rover, table, solved = read_traction(config.model, config.rover)
        if solved:
            self.get_logger().warning(solved)
        self._planner = Planner(table, model.prior_mean, model.prior_sd, config.advice)
        self._inputs = PlannerInputs(rover, config)
        self._period_ns, self._advised_ns, self._sequence = round(config.period_s * 1e9), 0, 0
        self._soils = [soil.name for soil in model.soils]
        self._model, self._warned = model, False
        self._output = self.create_publisher(message_class(ADVICE), "traction_advice", QOS)
        self.create_service(Trigger, "~/resume", self._resume)
        listened = LISTENED | (
            {"joint_states": INPUT_TYPES["joint_states"]} if config.use_torque else {}
        )
        self._inactivity = InactivityMonitor(self, listened, QOS)
        self._pairing = PairingMonitor(self, REQUIRED_INPUTS)
        for topic in self._inputs.topics:
            self._subscribe(topic)
        self.create_subscription(
            message_class(ESTIMATE), "terrain_estimate", guarded(self, self._take_estimate), QOS
        )
        if model.effects:
            names = ", ".join(effect.name for effect in model.effects)
            self.get_logger().warning(
                f"the model estimates {names}: the planner's statics leave it out (docs/planner.md)"
            )
        if not table.knows_loads:
            self.get_logger().warning(
                f"balances do not determine the wheel loads of {rover.name}, with"
                f" {rover.axles} axles and {len(rover.suspension)} joints: the ground under the"
                " front wheels is not judged, and margins take its body as rigid (docs/planner.md)"
            )
        self.get_logger().info(f"ready: rover {rover.name}, soils {', '.join(self._soils)}")

    def _subscribe(self, topic: str) -> None:
        def receive(message: Message) -> None:
            self._inactivity.received(topic)
            observations = self._inputs.add(topic, message)
            self._pairing.received(topic, paired=bool(observations))
            for observation in observations:
                if observation is not None:
                    self._planner.observe(observation)

        subscribe(self, INPUT_TYPES[topic], topic, guarded(self, receive), QOS)

    def _take_estimate(self, message: Message) -> None:
        """Advise once a period; stamps that step back, as in a looping bag, start a new period."""
        self._compare_models(message)
        self._inactivity.received("terrain_estimate")
        try:
            self._planner.believe(belief_of_message(message, self._soils))
        except ValueError as error:
            text = f"terrain_estimate of model {message.model_id} left out: {error}"
            self.get_logger().error(text, throttle_duration_sec=LOG_PERIOD_S)
            return
        now = stamp_ns(message)
        if 0 <= now - self._advised_ns < self._period_ns:
            return
        advice = self._planner.advise(now)
        if advice is not None:
            self._output.publish(advice_message(advice, make, self._sequence, message))
            self._sequence, self._advised_ns = self._sequence + 1, now

    def _compare_models(self, message: Message) -> None:
        """Warn once of an estimate by another model, which may be that of another rover."""
        if message.model_sha256 != self._model.sha256 and not self._warned:
            self._warned = True
            self.get_logger().warning(
                f"terrain_estimate is of model {message.model_id}, the planner's is"
                f" {self._model.model_id}: give both the same, or the advice may be for another"
                " rover"
            )

    def _resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._planner.resume()
        response.success, response.message = True, "the recommendation to stop is withdrawn"
        return response


def main() -> int:
    """Advise until SIGINT or SIGTERM; return 0, or 2 for wrong parameters or a wrong model."""
    return run(
        "planner", "stop_probability:=0.1", PlannerConfig, lambda stop: serve(PlannerNode(), stop)
    )


if __name__ == "__main__":
    sys.exit(main())
