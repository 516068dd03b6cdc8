# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A managed (lifecycle) node that starts itself unless told otherwise, and publishes diagnostics in every state."""

import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from rclpy.clock import Clock, ClockType, ROSClock
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.subscription import Subscription

from terrain_estimator.messaging.diagnostics import CLOCK, STATE, CheckResult
from terrain_estimator.nodes.common.declare import declare
from terrain_estimator.nodes.common.plain import POLL_S, guarded
from terrain_estimator.nodes.common.reporting import Reporter

ACTIVE, INACTIVE, UNCONFIGURED = "active", "inactive", "unconfigured"
_BEFORE = {"configure": UNCONFIGURED, "deactivate": ACTIVE}


class ManagedNode(LifecycleNode):
    """Wraps the transitions: what raises in one is said and leaves the node alive, in the state of before.

    A subclass gives ``configure``, ``activate``, ``deactivate`` and ``cleanup``, and judges itself
    in ``findings``.
    """

    def __init__(
        self,
        name: str,
        config: type[Any],
        stop: threading.Event,
        topics: Iterable[str] = (),
        **options: Any,
    ) -> None:
        """Declare the parameters.

        Args:
            name: of the node.
            config: of its parameters.
            stop: is set when the node is shut down.
            topics: see :func:`declare`.
            options: of rclpy's Node: a namespace or a context, where several nodes are in one
                process.

        Raises:
            ConfigError: a parameter is wrong.
        """
        super().__init__(name, automatically_declare_parameters_from_overrides=True, **options)
        self.config = declare(self, config, topics)
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.wrong = ""  # why the last transition failed
        self.failures = 0  # callbacks that raised
        self._stop = stop
        self._clock_ns, self._ticked_s = (
            0,
            time.monotonic(),
        )  # /clock as it was seen last, and since when by the steady clock
        self._reporter = Reporter(self, self._every_finding, self._count_failure)

    @abstractmethod
    def configure(self) -> None:
        """Load what is needed; may raise."""

    @abstractmethod
    def activate(self) -> None:
        """Begin; may raise."""

    @abstractmethod
    def deactivate(self) -> None:
        """Pause: answer what came, take nothing new. Never raises, and undoes an ``activate`` that raised half-way, too."""

    @abstractmethod
    def cleanup(self) -> None:
        """Let go of what ``configure`` loaded."""

    @abstractmethod
    def findings(self) -> Iterable[CheckResult]:
        """What is to be said of this node in /diagnostics beside its state and its clock."""

    @property
    def state(self) -> str:
        """Label of the present state."""
        return str(self._state_machine.current_state[1])

    def start(self) -> None:
        """Configure and activate; what fails is in the log."""
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def end(self) -> None:
        """Go back to where nothing is held, from any state."""
        if self.state == ACTIVE:
            self.trigger_deactivate()
        if self.state == INACTIVE:
            self.trigger_cleanup()

    def guard(self, callback: Callable[..., None]) -> Callable[..., None]:
        """A callback that never raises, and counts where it would have."""
        return guarded(self, callback, self._count_failure)

    def _count_failure(self) -> None:
        self.failures += 1

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """See rclpy."""
        return self._attempt("configure", self.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """See rclpy."""
        result = self._attempt("activate", self.activate)
        if result is not TransitionCallbackReturn.SUCCESS:
            self.deactivate()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """See rclpy."""
        return self._attempt("deactivate", self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """See rclpy."""
        return self._attempt("clean up", self.cleanup)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """See rclpy; the process ends."""
        self._stop.set()
        if state.label == ACTIVE:
            self._attempt("deactivate", self.deactivate)
        return (
            TransitionCallbackReturn.SUCCESS
            if state.label == UNCONFIGURED
            else self._attempt("clean up", self.cleanup)
        )

    def _attempt(self, what: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            action()
        except Exception as error:  # noqa: BLE001 - rclpy would take it for an error of its own and say nothing
            kind = "" if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: "
            self.wrong = f"cannot {what}: {kind}{error}"
            self.get_logger().error(f"{self.wrong}; the node stays {_BEFORE.get(what, INACTIVE)}")
            return TransitionCallbackReturn.FAILURE
        self.wrong = ""
        return TransitionCallbackReturn.SUCCESS

    def _every_finding(self) -> Iterator[CheckResult]:
        yield from self._of_every_node()
        yield from self.findings()

    def _of_every_node(self) -> Iterator[CheckResult]:
        yield STATE.judge(
            2.0 if self.wrong else float(self.state != ACTIVE), text=self.wrong or self.state
        )
        clock = self.get_clock()
        if isinstance(clock, ROSClock) and clock.ros_time_is_active:
            yield self._judge_clock(clock.now().nanoseconds)

    def _judge_clock(self, now_ns: int) -> CheckResult:
        """A /clock that stands still is wrong from its first moment on, and later: a recorder has no other time."""
        steady_s = time.monotonic()
        if now_ns != self._clock_ns:
            self._clock_ns, self._ticked_s = now_ns, steady_s
        passed_s = steady_s - self._ticked_s
        what = "/clock stands still" if now_ns else "no /clock came"
        return CLOCK.judge(
            passed_s,
            text=(
                f"use_sim_time is set, but {what} for {passed_s:.0f} s"
                if passed_s
                else "/clock runs"
            ),
        )

    def _LifecycleNodeMixin__on_change_state(self, request: Any, response: Any) -> Any:  # noqa: N802 - rclpy's own, by its mangled name
        """Refuse a transition that the state does not have: in rclpy the exception would end the process."""
        try:
            return super()._LifecycleNodeMixin__on_change_state(request, response)  # type: ignore[misc]
        except RuntimeError as error:
            self.get_logger().error(
                f"transition {request.transition.label or request.transition.id} refused in state"
                f" {self.state}: {error}"
            )
            response.success = False
            return response


def drain(subscriptions: Iterable[Subscription]) -> None:
    """Serve what waits in the queues, a message of each in turn as an executor does: nobody serves it once they are destroyed.

    Their callbacks take message and reception's details, and never raise. No more is taken than a
    queue holds: messages may go on coming.
    """
    waiting = list(subscriptions)
    for _ in range(max((each.qos_profile.depth for each in waiting), default=0)):
        waiting = [each for each in waiting if _serve(each)]


def _serve(subscription: Subscription) -> bool:
    """Whether a message waited."""
    with subscription.handle:
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    if taken is not None:
        subscription.callback(*taken)
    return taken is not None


def spin(node: ManagedNode, stop: threading.Event, *, auto_start: bool) -> None:
    """Serve callbacks until ``stop`` is set, then let go of everything.

    A turn never raises: rclpy's own callbacks do, at a /clock before zero for instance.
    """
    if auto_start:
        node.start()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    turn = node.guard(executor.spin_once)
    while not stop.is_set():
        turn(POLL_S)
    node.end()
