# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator as a managed node: wiring only. Messages in, the pipeline, messages out."""

import dataclasses
import gc
import math
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
import torch
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from std_srvs.srv import Trigger

from rover_parameters.records import ConfigError
from terrain_estimator.config import EstimatorNodeConfig
from terrain_estimator.estimator.saved_state import StateFileError, pack_state, read_state
from terrain_estimator.messaging.diagnostics import REQUIRED, CheckResult
from terrain_estimator.messaging.health import HealthMonitor
from terrain_estimator.messaging.messages import health_message
from terrain_estimator.messaging.pipeline import Answer, Pipeline
from terrain_estimator.model.model_file import load_model
from terrain_estimator.nodes.common.command_line import begin
from terrain_estimator.nodes.common.factory import make, message_class
from terrain_estimator.nodes.common.keeping import StateKeeper, beside, check_place, done, go_on
from terrain_estimator.nodes.common.managed import ManagedNode, drain, spin
from terrain_estimator.nodes.common.plain import refuse
from terrain_estimator.nodes.common.quality import listen
from terrain_estimator.nodes.common.silence import why_silent
from terrain_estimator.nodes.common.watchdog import unheard_publishers
from terrain_estimator.topics import HEALTH, INPUT_TYPES, OUTPUT_TYPES, Message

DEPTH = 50  # messages; 5 s at 10 Hz
QOS = QoSProfile(depth=DEPTH)  # reliable, volatile, keep last
HEALTH_PERIOD_S = 1.0


class EstimatorNode(ManagedNode):
    """Subscribes to the inputs, publishes an estimate and a prediction for each complete set, and its health at 1 Hz."""

    config: EstimatorNodeConfig

    def __init__(self, stop: threading.Event, **options: Any) -> None:
        """Read the parameters; ``options`` are rclpy's. Raises ConfigError where one is unknown or wrong."""
        super().__init__("estimator", EstimatorNodeConfig, stop, INPUT_TYPES, **options)
        self._pipeline: Pipeline | None = None
        self._keeper: StateKeeper | None = None
        self._health = HealthMonitor()
        self._heard_s: dict[str, float] = {}
        self._matched: set[str] = set()
        self._outputs = {
            topic: self.create_publisher(message_class(name), topic, QOS)
            for topic, name in OUTPUT_TYPES.items()
        }
        self._health_output = self.create_publisher(message_class(HEALTH), "estimator_health", QOS)
        self._listening: list[Subscription] = []
        self._ticking: list[Timer] = []
        self._judged: tuple[CheckResult, ...] = ()
        self._alone = threading.Lock()  # with the pipeline: services run beside the other callbacks where an executor has threads
        meanwhile = (
            ReentrantCallbackGroup()
        )  # else nothing would be served while a service waits for the disk
        for name, action in (
            ("reset", self._reset),
            ("save_state", self._save),
            ("load_state", self._load),
        ):
            self.create_service(
                Trigger, f"~/{name}", self._answering(action), callback_group=meanwhile
            )

    def configure(self) -> None:
        """Load the model, warm it up, and go on from the saved state where there is one."""
        model = load_model(self.config.estimator.model)
        pipeline = Pipeline(model, self.config.estimator)
        path = self._state_path
        if path is not None:
            check_place(path)
        keeper = StateKeeper(path, self.get_logger().error) if path else None
        if path is not None and path.exists() and not go_on(pipeline, path, self.get_logger()):
            pipeline = Pipeline(
                model, self.config.estimator
            )  # of the refused one it is not known what it took
        self._pipeline, self._health = pipeline, HealthMonitor(self._health.reported_failures)
        self._keeper = keeper
        gc.collect()
        gc.freeze()  # a full collection over torch's modules would stall an update

    def activate(self) -> None:
        """Subscribe and begin to report."""
        pipeline = self._configured
        self._heard_s.clear()
        self._ticking.append(
            self.create_timer(HEALTH_PERIOD_S, self.guard(self._publish_health), clock=self.steady)
        )
        if self._keeper:
            self._ticking.append(
                self.create_timer(
                    self.config.autosave_period_s, self.guard(self._autosave), clock=self.steady
                )
            )
        for topic in pipeline.inputs:
            self._subscribe(topic)
        self.get_logger().info(
            f"ready: model {pipeline.meta.model_id} for rover {pipeline.rover_name}, inputs"
            f" {', '.join(pipeline.inputs)}"
        )

    def deactivate(self) -> None:
        """Answer what came, sets that still wait for an optional message too, and take no more; what is known of the ground stays."""
        self.guard(drain)(self._listening)
        self.guard(self._answer_the_rest)()
        self.guard(self._autosave)()
        for subscription in self._listening:
            self.destroy_subscription(subscription)
        for timer in self._ticking:
            self.destroy_timer(timer)
        self._listening, self._ticking, self._judged = [], [], ()
        self._matched.clear()

    def cleanup(self) -> None:
        """Forget model and ground; the state that was given last is written first."""
        if self._keeper:
            self._keeper.end()
            self._keeper = None
        self._pipeline = None
        gc.unfreeze()
        gc.collect()

    def findings(self) -> Iterator[CheckResult]:
        """Inputs and updates as of the last report of health, publishers that are not heard, and the saved state."""
        yield from map(self._explained, self._judged)
        for each in self._listening:
            yield unheard_publishers(self, each.topic, INPUT_TYPES[each.topic], QOS)
        if self._keeper:
            yield self._keeper.judge()

    def _explained(self, finding: CheckResult) -> CheckResult:
        """With the reason, where a required input was never heard."""
        if finding.check is not REQUIRED or not finding.level or math.isfinite(finding.value):
            return finding
        reason = why_silent(self, finding.subject, INPUT_TYPES[finding.subject], QOS)
        return dataclasses.replace(finding, text=f"{finding.text}: {reason}")

    @property
    def _configured(self) -> Pipeline:
        if self._pipeline is None:
            raise StateFileError("the node is not configured")
        return self._pipeline

    @property
    def _state_path(self) -> Path | None:
        return Path(self.config.state_file).expanduser() if self.config.state_file else None

    def _answer_the_rest(self) -> None:
        with self._alone:
            answers = self._configured.flush()
        for answer in answers:
            self._publish(answer, 0.0)

    def _subscribe(self, topic: str) -> None:
        """Subscribe to one input; say once when all inputs have a publisher."""
        pipeline = self._configured

        def receive(message: Message, info: dict[str, int]) -> None:
            received_ns = (
                info["received_timestamp"] or time.time_ns()
            )  # by the wall clock; 0 where the middleware does not tell
            self._heard_s[topic] = time.monotonic()
            with self._alone:
                answers = pipeline.add(topic, message)
            for answer in answers:
                self._publish(
                    answer, max(0.0, (time.time_ns() - received_ns) * 1e-9)
                )  # that clock may be set back

        def match(info: QoSSubscriptionMatchedInfo) -> None:
            if info.current_count == 0:
                self._matched.discard(topic)
            elif topic not in self._matched:
                self._matched.add(topic)
                if len(self._matched) == len(pipeline.inputs):
                    self.get_logger().info(f"matched all inputs: {', '.join(pipeline.inputs)}")

        events = SubscriptionEventCallbacks(matched=match)
        self._listening.append(
            listen(
                self, INPUT_TYPES[topic], topic, self.guard(receive), QOS, event_callbacks=events
            )
        )

    def _publish(self, answer: Answer, latency_s: float) -> None:
        for topic, message in answer.messages(make, self._configured.meta).items():
            self._outputs[topic].publish(message)
        self._health.observe(answer.update, latency_s)
        for warning in answer.update.warnings:
            self.get_logger().warning(warning)

    def _publish_health(self) -> None:
        pipeline, now = self._configured, time.monotonic()
        ages = {topic: now - heard for topic, heard in self._heard_s.items()}
        self._health.failures, self._health.resets = self.failures, pipeline.resets
        report = self._health.report(pipeline.counters, ages)
        self._judged = report.findings
        header = make(
            "std_msgs/msg/Header",
            stamp=self.get_clock().now().to_msg(),
            frame_id=pipeline.meta.body_frame,
        )
        self._health_output.publish(health_message(report, make, pipeline.meta, header))

    def _autosave(self) -> None:
        if self._keeper:
            self._keeper.give(self._packed())

    def _packed(self) -> bytes:
        with self._alone:
            return pack_state(self._configured.save(), self._configured.meta.model_sha256)

    async def _reset(self) -> str:
        with self._alone:
            self._configured.reset()
        return "the posterior is the prior again"

    async def _save(self) -> str:
        keeper = self._kept
        await done(keeper.give(self._packed()))
        return f"the state is in {keeper.path}"

    async def _load(self) -> str:
        path, model = self._kept.path, self._configured.meta.model_sha256
        arrays = await done(beside(partial(read_state, path, model)))
        with self._alone:
            self._configured.restore(arrays)
        return f"going on from the state in {path}"

    @property
    def _kept(self) -> StateKeeper:
        if self._state_path is None:
            raise StateFileError("no file is named: start the node with the parameter state.file")
        if self._keeper is None:
            raise StateFileError("the node is not configured")
        return self._keeper

    def _answering(
        self, action: Callable[[], Awaitable[str]]
    ) -> Callable[[Trigger.Request, Trigger.Response], Coroutine[Any, Any, Trigger.Response]]:
        """A service that says what it did, or why not."""

        async def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.success, response.message = True, await action()
                self.get_logger().info(response.message)
            except Exception as error:  # noqa: BLE001 - whatever the file holds, the node goes on
                response.success, response.message = False, str(error)
                self.get_logger().error(response.message)
            return response

        return serve


def main() -> int:
    """Estimate until SIGINT or SIGTERM.

    Returns:
        0 after a signal, a shutdown or ``--help``, 2 where arguments or parameters are wrong.
    """
    torch.set_num_threads(1)
    try:
        stop = begin("estimator", "model:=FILE", EstimatorNodeConfig)
        node = EstimatorNode(stop)
        spin(node, stop, auto_start=node.config.auto_start)
        node.destroy_node()
    except ConfigError as error:
        return refuse("estimator", error)
    finally:
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
