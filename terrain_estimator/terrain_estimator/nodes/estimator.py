# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run the estimator as a managed node: messages in, the pipeline, messages out."""

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

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from std_srvs.srv import Trigger

from rover_parameters.command_line import run
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import EstimatorNodeConfig
from terrain_estimator.estimator.saved_state import StateFileError, pack_state
from terrain_estimator.messaging.averaging import Rate, Treatment
from terrain_estimator.messaging.diagnostics import (
    REQUIRED,
    CheckResult,
    judge_information,
    judge_runtime,
)
from terrain_estimator.messaging.health import HealthMonitor
from terrain_estimator.messaging.messages import health_message
from terrain_estimator.messaging.pipeline import Answer, Pipeline
from terrain_estimator.nodes.common.inactivity import explain_silence
from terrain_estimator.nodes.common.lifecycle import ManagedNode, drain
from terrain_estimator.nodes.common.message_types import make, message_class
from terrain_estimator.nodes.common.publishers import incompatible_publishers
from terrain_estimator.nodes.common.qos import subscribe
from terrain_estimator.nodes.common.state_file import (
    StateFileWriter,
    check_state_path,
    completed,
    in_thread,
    restore,
)
from terrain_estimator.offline.reference_drives import judge_sensors
from terrain_estimator.offline.state_files import read_state
from terrain_estimator.topics import HEALTH, INPUT_TYPES, OUTPUT_TYPES, Message

DEPTH = 50  # messages; 5 s at 10 Hz
QOS = QoSProfile(depth=DEPTH)  # reliable, volatile, keep last
HEALTH_PERIOD_S = 1.0


class EstimatorNode(ManagedNode):
    """Publish an estimate and a prediction for each complete set of inputs, and health at 1 Hz."""

    config: EstimatorNodeConfig
    live = frozenset({"gate_probability"})

    def __init__(self, stop: threading.Event, **options: Any) -> None:
        """Read the parameters; ``options`` are rclpy's. Raises ConfigError where one is wrong."""
        super().__init__("estimator", EstimatorNodeConfig, stop, INPUT_TYPES, **options)
        self._pipeline: Pipeline | None = None
        self._why = ""  # the compiled core does not run although it was looked for
        self._sensors: CheckResult | None = None  # what the configured sensors tell
        self._state_file: StateFileWriter | None = None
        self._health = HealthMonitor()
        self._received_s: dict[str, float] = {}
        self._matched: set[str] = set()
        self._outputs = {
            topic: self.create_publisher(message_class(name), topic, QOS)
            for topic, name in OUTPUT_TYPES.items()
        }
        self._health_output = self.create_publisher(message_class(HEALTH), "estimator_health", QOS)
        self._input_subscriptions: list[Subscription] = []
        self._active_timers: list[Timer] = []
        self._judged: tuple[CheckResult, ...] = ()
        self._treatment: Treatment | None = None  # the last one that was logged
        # guards the pipeline: an executor with threads runs services beside the other callbacks
        self._pipeline_lock = threading.Lock()
        # other callbacks run while a service waits for the disk
        reentrant = ReentrantCallbackGroup()
        for name, action in (
            ("reset", self._reset),
            ("save_state", self._save),
            ("load_state", self._load),
        ):
            self.create_service(
                Trigger, f"~/{name}", self._trigger_service(action), callback_group=reentrant
            )

    def configure(self) -> None:
        """Load the model, warm it up, and restore the saved state where there is one."""
        given = self.config.estimator
        chosen = load(given.model, given.runtime)
        if chosen.why:
            self.get_logger().warning(f"the model runs by TorchScript: {chosen.why}")
        model, config = chosen.model, dataclasses.replace(given, runtime=chosen.runtime)
        pipeline = Pipeline(model, config)
        sensors, doubt = judge_sensors(model, config)
        if doubt:
            self.get_logger().warning(doubt)
        path = self._state_path
        if path is not None:
            check_state_path(path)
        state_file = StateFileWriter(path, self.get_logger().error) if path else None
        if path is not None and path.exists() and not restore(pipeline, path, self.get_logger()):
            # a state that is refused may have been restored in part
            pipeline = Pipeline(model, config)
        self._why = chosen.why
        self._sensors = judge_information(sensors.largest, sensors.bounds, doubt)
        self._pipeline, self._health = pipeline, HealthMonitor(self._health.reported_failures)
        self._state_file = state_file
        gc.collect()
        gc.freeze()  # a full collection over torch's modules would stall an update

    def activate(self) -> None:
        """Subscribe, and start the timers of health and autosave."""
        pipeline = self._configured
        self._received_s.clear()
        self._active_timers.append(
            self.create_timer(HEALTH_PERIOD_S, self.guard(self._publish_health), clock=self.steady)
        )
        if self._state_file:
            self._active_timers.append(
                self.create_timer(
                    self.config.autosave_period_s, self.guard(self._autosave), clock=self.steady
                )
            )
        for topic in pipeline.inputs:
            self._subscribe(topic)
        self.get_logger().info(
            f"ready: model {pipeline.meta.model_id} ({pipeline.runtime}) for rover"
            f" {pipeline.rover_name}, inputs {', '.join(pipeline.inputs)}"
        )

    def deactivate(self) -> None:
        """Process what has arrived, incomplete sets too, and unsubscribe; the posterior stays."""
        self.guard(drain)(self._input_subscriptions)
        self.guard(self._flush)()
        self.guard(self._autosave)()
        for subscription in self._input_subscriptions:
            self.destroy_subscription(subscription)
        for timer in self._active_timers:
            self.destroy_timer(timer)
        self._input_subscriptions, self._active_timers, self._judged = [], [], ()
        self._matched.clear()

    def cleanup(self) -> None:
        """Write the last state, then release the model and the posterior."""
        if self._state_file:
            self._state_file.close()
            self._state_file = None
        self._pipeline = None
        gc.unfreeze()
        gc.collect()

    def change(self) -> None:
        """Take another gate from the next observation on."""
        with self._pipeline_lock:
            self._configured.set_gate_probability(self.config.estimator.core.gate_probability)

    def findings(self) -> Iterator[CheckResult]:
        """Return the checks of the last health report, of runtime, publishers and saved state."""
        yield from map(self._explained, self._judged)
        if self._pipeline:
            sha256 = self._pipeline.meta.configuration_sha256
            yield judge_runtime(self._pipeline.runtime, self._why, sha256)
            if self._sensors:
                yield self._sensors
        for each in self._input_subscriptions:
            yield incompatible_publishers(self, each.topic, INPUT_TYPES[each.topic], QOS)
        if self._state_file:
            yield self._state_file.judge()

    def _explained(self, finding: CheckResult) -> CheckResult:
        """Add the reason to a required input that never arrived."""
        if finding.check is not REQUIRED or not finding.level or math.isfinite(finding.value):
            return finding
        reason = explain_silence(self, finding.subject, INPUT_TYPES[finding.subject], QOS)
        return dataclasses.replace(finding, text=f"{finding.text}: {reason}")

    @property
    def _configured(self) -> Pipeline:
        if self._pipeline is None:
            raise StateFileError("the node is not configured")
        return self._pipeline

    @property
    def _state_path(self) -> Path | None:
        return Path(self.config.state_file).expanduser() if self.config.state_file else None

    def _flush(self) -> None:
        with self._pipeline_lock:
            answers = self._configured.flush()
        for answer in answers:
            self._publish(answer, 0.0)

    def _subscribe(self, topic: str) -> None:
        """Subscribe to one input; log when all inputs have a publisher."""
        pipeline = self._configured

        def receive(message: Message, info: dict[str, int]) -> None:
            # by the wall clock; the middleware may give 0
            received_ns = info["received_timestamp"] or time.time_ns()
            self._received_s[topic] = time.monotonic()
            with self._pipeline_lock:
                answers = pipeline.add(topic, message)
            for answer in answers:
                # the wall clock may be set back
                self._publish(answer, max(0.0, (time.time_ns() - received_ns) * 1e-9))

        def match(info: QoSSubscriptionMatchedInfo) -> None:
            if info.current_count == 0:
                self._matched.discard(topic)
            elif topic not in self._matched:
                self._matched.add(topic)
                if len(self._matched) == len(pipeline.inputs):
                    self.get_logger().info(f"matched all inputs: {', '.join(pipeline.inputs)}")

        events = SubscriptionEventCallbacks(matched=match)
        self._input_subscriptions.append(
            subscribe(
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
        ages = {topic: now - received for topic, received in self._received_s.items()}
        self._health.failures, self._health.resets = self.failures, pipeline.resets
        rate = pipeline.rate
        self._log_rate(rate)
        report = self._health.report(pipeline.counters, ages, rate)
        self._judged = report.findings
        header = make(
            "std_msgs/msg/Header",
            stamp=self.get_clock().now().to_msg(),
            frame_id=pipeline.meta.body_frame,
        )
        self._health_output.publish(health_message(report, make, pipeline.meta, header))

    def _log_rate(self, rate: Rate) -> None:
        """Log the rate of the readings when their treatment changes."""
        if math.isnan(rate.hz) or rate.treatment is self._treatment:
            return
        changed, self._treatment = self._treatment is not None, rate.treatment
        if changed or not rate.is_normal:
            log = self.get_logger().warning if rate.treatment else self.get_logger().info
            log(f"readings come at {rate}")

    def _autosave(self) -> None:
        if self._state_file:
            self._state_file.write(self._packed())

    def _packed(self) -> bytes:
        with self._pipeline_lock:
            return pack_state(self._configured.save(), self._configured.meta.model_sha256)

    async def _reset(self) -> str:
        with self._pipeline_lock:
            self._configured.reset()
        return "the posterior is the prior again"

    async def _save(self) -> str:
        state_file = self._named_state_file
        await completed(state_file.write(self._packed()))
        return f"the state is in {state_file.path}"

    async def _load(self) -> str:
        path, model = self._named_state_file.path, self._configured.meta.model_sha256
        arrays = await completed(in_thread(partial(read_state, path, model)))
        with self._pipeline_lock:
            self._configured.restore(arrays, str(path))
        return f"going on from the state in {path}"

    @property
    def _named_state_file(self) -> StateFileWriter:
        if self._state_path is None:
            raise StateFileError("no file is named: start the node with the parameter state.file")
        if self._state_file is None:
            raise StateFileError("the node is not configured")
        return self._state_file

    def _trigger_service(
        self, action: Callable[[], Awaitable[str]]
    ) -> Callable[[Trigger.Request, Trigger.Response], Coroutine[Any, Any, Trigger.Response]]:
        """Return a service callback that answers with the result of an action, or its error."""

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
    """Estimate until SIGINT, SIGTERM or a shutdown; return 0, or 2 for wrong parameters."""
    return run("estimator", "model:=FILE", EstimatorNodeConfig, _serve)


def _serve(stop: threading.Event) -> int:
    node = EstimatorNode(stop)
    node.serve(auto_start=node.config.auto_start)
    return 0


if __name__ == "__main__":
    sys.exit(main())
