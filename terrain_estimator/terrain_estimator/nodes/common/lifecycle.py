# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A managed (lifecycle) node that can start itself and publishes diagnostics in every state."""

import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType, ROSClock
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription

from rover_parameters.declare import in_force
from rover_parameters.ending import destroy
from rover_parameters.parameters import check, configure, effective
from rover_parameters.records import ConfigError, shortened
from terrain_estimator.messaging.diagnostics import CLOCK, STATE, CheckResult
from terrain_estimator.nodes.common.declare import declare
from terrain_estimator.nodes.common.diagnostics import DiagnosticsPublisher
from terrain_estimator.nodes.common.executor import take_message
from terrain_estimator.nodes.common.running import POLL_S, guarded, guarded_turn, serve_on

ACTIVE, INACTIVE, UNCONFIGURED = "active", "inactive", "unconfigured"
FINALIZED = "finalized"
LATER = "as soon as the node is configured"
_BEFORE = {"configure": UNCONFIGURED, "deactivate": ACTIVE}


class ManagedNode(LifecycleNode):
    """A lifecycle node whose transitions never raise: a failure is logged and keeps the old state.

    A subclass gives ``configure``, ``activate``, ``deactivate`` and ``cleanup``, and its checks in
    ``findings``. Its parameters can be set unless it is active, and take effect when it is
    configured; those in ``live`` can be set at any time, and ``change`` applies them.
    """

    live: ClassVar[frozenset[str]] = frozenset()
    fixed: ClassVar[frozenset[str]] = frozenset({"auto_start"})

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
            stop: ends :meth:`serve`; the transition "shutdown" sets it.
            topics: those whose subscriptions take ``qos_overrides``.
            options: of rclpy's Node: arguments or a context of its own, where several nodes are in
                one process.

        Raises:
            ConfigError: a parameter is wrong.
        """
        super().__init__(name, automatically_declare_parameters_from_overrides=True, **options)
        self.config = declare(
            self,
            config,
            topics,
            changeable=True,
            fixed=self.fixed,
            arguments=options.get("cli_args"),
        )
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.wrong = ""  # why the last transition failed
        self.failures = 0  # callbacks that raised
        self._stop = stop
        # the last time of /clock, and the steady time of its last change
        self._clock_ns, self._ticked_s = 0, time.monotonic()
        self._diagnostics = DiagnosticsPublisher(self, self._every_finding, self._count_failure)
        self.add_on_set_parameters_callback(self._judge_parameters)
        self.add_post_set_parameters_callback(self.guard(self._take_parameters))

    @abstractmethod
    def configure(self) -> None:
        """Load everything that the node needs; may raise."""

    @abstractmethod
    def activate(self) -> None:
        """Start to work; may raise."""

    @abstractmethod
    def deactivate(self) -> None:
        """Process what has arrived, then accept nothing new.

        Never raises. Also undoes an ``activate`` that raised half-way.
        """

    @abstractmethod
    def cleanup(self) -> None:
        """Release everything that ``configure`` loaded."""

    def change(self) -> None:
        """Apply the live parameters of ``config`` to what ``configure`` loaded."""

    @abstractmethod
    def findings(self) -> Iterable[CheckResult]:
        """Return the checks for /diagnostics beside those of state and clock."""

    @property
    def exit_code(self) -> int:
        """The exit code of a process that serves this node."""
        return 0

    @property
    def state(self) -> str:
        """The label of the present state."""
        return str(self._state_machine.current_state[1])

    def serve(self, *, auto_start: bool) -> None:
        """Serve callbacks until ``stop`` is set, then release everything and destroy the node."""
        if auto_start:
            self.start()
        turn = guarded_turn(self, self._count_failure)
        while not self._stop.is_set():
            turn(POLL_S)
        if self.state == FINALIZED:
            serve_on(turn)
        self.end()
        destroy(self, self.exit_code)

    def start(self) -> None:
        """Configure and activate; a failure is logged."""
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def end(self) -> None:
        """Deactivate and clean up, as far as the state needs it."""
        if self.state == ACTIVE:
            self.trigger_deactivate()
        if self.state == INACTIVE:
            self.trigger_cleanup()

    def destroy_node(self) -> None:
        """Destroy the node, and its state machine, which would keep its name in the graph."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def guard(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Wrap a callback so that an exception is logged and counted instead of raised."""
        return guarded(self, callback, self._count_failure)

    def _count_failure(self) -> None:
        self.failures += 1

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Configure, as rclpy asks."""
        return self._attempt("configure", self._configure_anew)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Activate, as rclpy asks, and deactivate again where that fails."""
        result = self._attempt("activate", self.activate)
        if result is not TransitionCallbackReturn.SUCCESS:
            self.deactivate()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Deactivate, as rclpy asks."""
        return self._attempt("deactivate", self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Clean up, as rclpy asks."""
        return self._attempt("clean up", self.cleanup)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything, as rclpy asks, and end the process."""
        self._stop.set()
        if state.label == ACTIVE:
            self._attempt("deactivate", self.deactivate)
        return (
            TransitionCallbackReturn.SUCCESS
            if state.label == UNCONFIGURED
            else self._attempt("clean up", self.cleanup)
        )

    def _configure_anew(self) -> None:
        self.config = in_force(self, type(self.config))
        self.configure()

    def _judge_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse a value by itself; ``configure`` judges whether the values fit together."""
        known = effective(self.config)
        try:
            for each in changes:
                if each.name in known:  # not one of ROS's own
                    self._check_change(each)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _check_change(self, parameter: Parameter) -> None:
        check(type(self.config), parameter.name, parameter.value)
        if parameter.name not in self.live and self.state not in {UNCONFIGURED, INACTIVE}:
            raise ConfigError(
                f"parameter {parameter.name}: the node is {self.state}: deactivate it, set the"
                " parameter, then clean up, configure and activate the node"
            )

    def _take_parameters(self, changes: list[Parameter]) -> None:
        known = effective(self.config)
        changed = {each.name: each.value for each in changes if each.name in known}
        live = {name: value for name, value in changed.items() if name in self.live}
        if live and self.state != UNCONFIGURED:
            self.config = configure(type(self.config), known | live)
            self.change()
        later = [name for name in changed if name not in live or self.state == UNCONFIGURED]
        for words, names in (("from now on", set(changed).difference(later)), (LATER, later)):
            if names:
                self.get_logger().info(f"{words}: {_shown(names, changed)}")

    def _attempt(self, what: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            action()
        except Exception as error:  # noqa: BLE001 - rclpy would end the node without a message
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
        """Judge for how long /clock has stood still: a recorder has no other time."""
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

    # rclpy's own method, by its mangled name
    def _LifecycleNodeMixin__on_change_state(self, request: Any, response: Any) -> Any:  # noqa: N802
        """Refuse a transition that the state does not allow; rclpy would end the process."""
        try:
            change = super()._LifecycleNodeMixin__on_change_state  # type: ignore[misc]
            return change(request, response)
        except RuntimeError as error:
            self.get_logger().error(
                f"transition {request.transition.label or request.transition.id} refused in state"
                f" {self.state}: {error}"
            )
            response.success = False
            return response


def _shown(names: Iterable[str], values: Mapping[str, object]) -> str:
    return ", ".join(f"{name} = {shortened(values[name])}" for name in names)


def drain(subscriptions: Iterable[Subscription]) -> None:
    """Process the messages that wait in the queues, one of each in turn, as an executor does.

    Destroying a subscription would lose them. The callbacks never raise. At most a full queue of
    each is taken: messages may go on arriving.
    """
    waiting = list(subscriptions)
    for _ in range(max((each.qos_profile.depth for each in waiting), default=0)):
        waiting = [each for each in waiting if take_message(each)]
