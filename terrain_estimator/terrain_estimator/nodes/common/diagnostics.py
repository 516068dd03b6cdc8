# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Publish the checks of a node on /diagnostics, and log those that stay wrong."""

import math
import time
from collections.abc import Callable, Iterable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from terrain_estimator.messaging.diagnostics import REQUIRED, CheckResult, Level
from terrain_estimator.nodes.common.inactivity import merged
from terrain_estimator.nodes.common.running import guarded

PERIOD_S = 1.0
PATIENCE_S = 5.0
"""A check that fails for so long is logged."""


class DiagnosticsPublisher:
    """Evaluate and publish the checks of a node once a second of the steady clock."""

    def __init__(
        self,
        node: Node,
        findings: Callable[[], Iterable[CheckResult]],
        failed: Callable[[], None] = lambda: None,
    ) -> None:
        """Start a timer; ``failed`` is called where ``findings`` raises."""
        self._node, self._findings = node, findings
        self._since_s: dict[str, float] = {}  # start of each failure, by the steady clock
        self._logged: set[str] = set()
        self._output = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_timer(
            PERIOD_S,
            guarded(node, self._publish, failed),
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )

    def _publish(self) -> None:
        findings = [*self._findings()]
        name = self._node.get_fully_qualified_name()
        status = [
            DiagnosticStatus(
                level=bytes([finding.level]),
                name=f"{name}: {finding.name}",
                message=finding.message,
                hardware_id=name,
                values=[
                    KeyValue(key="value", value=f"{finding.value:g}"),
                    KeyValue(key="unit", value=finding.check.unit or "1"),
                    *(KeyValue(key=key, value=value) for key, value in finding.details),
                ],
            )
            for finding in findings
        ]
        message = DiagnosticArray(status=status)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._output.publish(message)
        self._log(findings)

    def _log(self, findings: list[CheckResult]) -> None:
        """Log one line when a failure has lasted, and one when it is over."""
        now, node = time.monotonic(), self._node
        wrong = {
            finding.name: finding
            for finding in findings
            if finding.level and not math.isnan(finding.value)
        }
        self._since_s = {name: self._since_s.get(name, now) for name in wrong}
        new = [
            name
            for name, since_s in self._since_s.items()
            if now - since_s >= PATIENCE_S - PERIOD_S / 2 and name not in self._logged
        ]
        never = [
            name for name in new if wrong[name].check is REQUIRED and math.isinf(wrong[name].value)
        ]
        for line in merged({wrong[name].subject: wrong[name].message for name in never}):
            node.get_logger().error(line)
        for each in (wrong[name] for name in new if name not in never):
            # two calls: rclpy raises where one line of code logs at two levels
            if each.level is Level.WARN:
                node.get_logger().warning(each.message)
            else:
                node.get_logger().error(each.message)
        # a paused node does not judge its inputs
        judged = {finding.name for finding in findings}
        for name in sorted(self._logged & judged - set(wrong)):
            node.get_logger().info(f"{name}: all is well again")
        self._logged = (self._logged & set(wrong)) | set(new)
