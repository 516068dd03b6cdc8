# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator as a node: wiring only. Messages in, the pipeline, messages out."""

import gc
import sys
import threading
import time
from collections.abc import Callable

import rclpy
import torch
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_srvs.srv import Trigger

from terrain_estimator.config import EstimatorConfig
from terrain_estimator.health import HealthMonitor
from terrain_estimator.messages import health_message
from terrain_estimator.model_file import ModelFileError, load_model
from terrain_estimator.nodes.command_line import begin
from terrain_estimator.nodes.declare import declare
from terrain_estimator.nodes.factory import make, message_class
from terrain_estimator.pipeline import Answer, Pipeline
from terrain_estimator.ros_types import HEALTH, INPUT_TYPES, OUTPUT_TYPES, Message
from terramechanics.loading import ConfigError

DEPTH = 50  # messages; 5 s at 10 Hz
QOS = QoSProfile(depth=DEPTH)  # reliable, volatile, keep last
HEALTH_PERIOD_S = 1.0
POLL_S = 0.1
LOG_PERIOD_S = 5.0


class EstimatorNode(Node):
    """Subscribes to the inputs, publishes an estimate and a prediction for each complete set, and its health at 1 Hz."""

    def __init__(self) -> None:
        """Read parameters and model, then subscribe.

        Raises:
            ConfigError: a parameter is unknown or wrong.
            ModelFileError: the model file is missing, damaged or for another rover.
        """
        super().__init__("estimator", automatically_declare_parameters_from_overrides=True)
        config = declare(self, EstimatorConfig)
        model = load_model(config.model)
        self._pipeline = Pipeline(model, config)
        self._health = HealthMonitor()
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._heard_s: dict[str, float] = {}
        self._matched: set[str] = set()
        self._outputs = {topic: self.create_publisher(message_class(name), topic, QOS) for topic, name in OUTPUT_TYPES.items()}
        self._health_output = self.create_publisher(message_class(HEALTH), "estimator_health", QOS)
        self.create_service(Trigger, "~/reset", self._reset)
        self.create_timer(HEALTH_PERIOD_S, self._guard(self._publish_health), clock=self._steady)
        for topic in self._pipeline.inputs:
            self._subscribe(topic)
        self.get_logger().info(f"ready: model {model.model_id} for rover {model.rover.name}, inputs {', '.join(self._pipeline.inputs)}")

    def finish(self) -> None:
        """Answer the sets that still wait for an optional message."""
        for answer in self._pipeline.flush():
            self._publish(answer, 0.0)

    def _subscribe(self, topic: str) -> None:
        """Subscribe to one input; say once when all inputs have a publisher."""

        def receive(message: Message) -> None:
            start = time.perf_counter()
            self._heard_s[topic] = time.monotonic()
            for answer in self._pipeline.add(topic, message):
                self._publish(answer, time.perf_counter() - start)

        def match(info: QoSSubscriptionMatchedInfo) -> None:
            if info.current_count == 0:
                self._matched.discard(topic)
            elif topic not in self._matched:
                self._matched.add(topic)
                if len(self._matched) == len(self._pipeline.inputs):
                    self.get_logger().info(f"matched all inputs: {', '.join(self._pipeline.inputs)}")

        events = SubscriptionEventCallbacks(matched=match)
        self.create_subscription(message_class(INPUT_TYPES[topic]), topic, self._guard(receive), QOS, event_callbacks=events)

    def _publish(self, answer: Answer, latency_s: float) -> None:
        for topic, message in answer.messages(make, self._pipeline.meta).items():
            self._outputs[topic].publish(message)
        self._health.observe(answer.update, latency_s)

    def _publish_health(self) -> None:
        now = time.monotonic()
        ages = {topic: now - heard for topic, heard in self._heard_s.items()}
        report = self._health.report(self._pipeline.counters, ages)
        header = make("std_msgs/msg/Header", stamp=self.get_clock().now().to_msg(), frame_id=self._pipeline.meta.body_frame)
        self._health_output.publish(health_message(report, make, self._pipeline.meta, header))

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._pipeline.reset()
        self._health.resets += 1
        response.success, response.message = True, "the posterior is the prior again"
        self.get_logger().info(response.message)
        return response

    def _guard(self, callback: Callable[..., None]) -> Callable[..., None]:
        """A callback that never raises: whatever a message does, the node stays alive, counts it and says so."""

        def guarded(*arguments: Message) -> None:
            try:
                callback(*arguments)
            except Exception as error:  # noqa: BLE001 - the last line of defence of a node that has to keep running
                self._health.failures += 1
                self.get_logger().error(
                    f"{type(error).__name__} in a callback, the message is left out: {error}", throttle_duration_sec=LOG_PERIOD_S
                )

        return guarded


def main() -> int:
    """Estimate until SIGINT or SIGTERM.

    Returns:
        0 after a signal or ``--help``, 2 where arguments, parameters or the model are wrong.
    """
    try:
        stop = begin("estimator", "model:=FILE", EstimatorConfig)
    except ConfigError as error:
        return _refuse(str(error))
    torch.set_num_threads(1)
    try:
        return _run(stop)
    finally:
        rclpy.try_shutdown()


def _run(stop: threading.Event) -> int:
    try:
        node = EstimatorNode()
    except (ModelFileError, ConfigError) as error:
        return _refuse(str(error))
    gc.collect()
    gc.freeze()  # a full collection over torch's modules would stall an update
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set():
        executor.spin_once(timeout_sec=POLL_S)
    for _ in range(DEPTH * len(INPUT_TYPES)):
        executor.spin_once(timeout_sec=0)
    node.finish()
    node.destroy_node()
    return 0


def _refuse(text: str) -> int:
    print(f"estimator: {text}", file=sys.stderr)  # noqa: T201 - there is no node yet, hence no logger
    return 2


if __name__ == "__main__":
    sys.exit(main())
