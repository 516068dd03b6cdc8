# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""An executor that wakes up for a message at a fraction of the cost of rclpy's.

rclpy's executor puts its wait set together anew before each wait: it filters every service, timer
and event by its callback group, enters a context for each, and makes a task of each callback. At
five topics and 10 Hz that was more than half of the estimator's processor time (py-spy). Messages
are what comes often, so they alone are served directly here. All else is left to rclpy's
executor, which finds it ready.

rclpy's own answer, the EventsExecutor, cannot serve this package's services (ros2/rclpy#1478) and
ends the process where a callback of rclpy raises (ros2/rclpy#1641).
"""

from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription
from rclpy.waitable import NumberOfEntities, Waitable

_FOREVER_NS = -1
ROUNDS = 20
"""[1] Messages of each topic that may follow before timers and services are served again."""


class MessageExecutor(SingleThreadedExecutor):
    """Serve nodes in one thread, subscriptions directly, all else as rclpy does.

    The callback of a subscription must not be a coroutine. Its callback group is not asked: in one
    thread nothing else runs while it does, and a service that awaits something shares no group with
    it (see ``ReentrantCallbackGroup`` in the estimator).
    """

    def __init__(self, *, context: Context | None = None) -> None:
        """Begin without a node, in rclpy's own context where none is given."""
        super().__init__(context=context)
        self._asked: list[Waitable] = []
        self._sizes = NumberOfEntities()

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Wait at most ``timeout_sec`` [s] (None: without end) and serve what is ready.

        While a topic has another message, one of every topic is served without another wait.
        Raises what a callback raises; what else was ready is served by the next call.
        """
        # coroutines that await something: rclpy's executor takes their steps
        if any(not task.done() for task, _, _ in self._tasks):
            super().spin_once(timeout_sec)
            return
        timeout_ns = _FOREVER_NS if timeout_sec is None else max(0, round(timeout_sec * 1e9))
        messages, others = self._ready(timeout_ns)
        if others:
            super().spin_once(0.0)
        for subscription in messages:
            take_message(subscription)
        # to ask in vain costs a twentieth of a wait
        for _ in range(ROUNDS if messages else 0):
            if not take_message(messages[0]):
                break
            # every topic: none may get ahead of those with which its messages are paired
            for subscription in self._subscriptions():
                if subscription is not messages[0]:
                    take_message(subscription)

    def _subscriptions(self) -> list[Subscription]:
        return [each for node in self.get_nodes() for each in node.subscriptions]

    def _ready(self, timeout_ns: int) -> tuple[list[Subscription], bool]:
        """Wait; return the subscriptions with a message, and whether anything else is ready."""
        nodes = self.get_nodes()
        subscriptions = self._subscriptions()
        guards = [each for node in nodes for each in node.guards]
        timers = [each for node in nodes for each in node.timers]
        clients = [each for node in nodes for each in node.clients]
        services = [each for node in nodes for each in node.services]
        events = [each for node in nodes for each in node.waitables]
        own = (self._guard, self._sigint_gc)
        sizes = self._sizes_of(events)
        wait_set = rclpy_implementation.WaitSet(
            len(subscriptions) + sizes.num_subscriptions,
            len(guards) + len(own) + sizes.num_guard_conditions,
            len(timers) + sizes.num_timers,
            len(clients) + sizes.num_clients,
            len(services) + sizes.num_services,
            sizes.num_events,
            self._context.handle,
        )
        wait_set.clear_entities()
        for subscription in subscriptions:
            wait_set.add_subscription(subscription.handle)
        for guard in (*guards, *own):
            wait_set.add_guard_condition(guard.handle)
        for timer in timers:
            wait_set.add_timer(timer.handle)
        for client in clients:
            wait_set.add_client(client.handle)
        for service in services:
            wait_set.add_service(service.handle)
        for event in events:
            event.add_to_wait_set(wait_set)
        wait_set.wait(timeout_ns)
        triggered = wait_set.get_ready_entities("guard_condition")
        for guard in guards:  # the wait has reset it: rclpy's executor triggers it again
            guard._executor_triggered |= guard.handle.pointer in triggered  # noqa: SLF001
        others = (
            bool(triggered)
            or any(wait_set.get_ready_entities(kind) for kind in ("timer", "service", "client"))
            or any(event.is_ready(wait_set) for event in events)
        )
        ready = wait_set.get_ready_entities("subscription")
        return [each for each in subscriptions if each.handle.pointer in ready], others

    def _sizes_of(self, waitables: list[Waitable]) -> NumberOfEntities:
        """Return how many entities waitables have; others than the last ones are asked anew."""
        if waitables != self._asked:
            self._asked = waitables
            self._sizes = sum((each.get_num_entities() for each in waitables), NumberOfEntities())
        return self._sizes


def take_message(subscription: Subscription) -> bool:
    """Process one message; return whether there was one. A destroyed subscription has none."""
    try:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    except InvalidHandle:
        return False
    if taken is None:
        return False
    if subscription._callback_type is Subscription.CallbackType.MessageOnly:  # noqa: SLF001
        taken = taken[:1]
    subscription.callback(*taken)
    return True
