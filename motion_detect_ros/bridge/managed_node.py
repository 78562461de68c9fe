"""The frame that every node of the package stands in: lifecycle, diagnostics, reset, clean end."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, qos_policy_name_from_kind
from rclpy.task import Future
from std_srvs.srv import Trigger

from motion_detect_ros.bridge.console import endpoints
from motion_detect_ros.bridge.diagnostics import SUBSCRIBERS_OF, Condition, Reporter, StageStats
from motion_detect_ros.bridge.lifecycle_states import destroy_states, refuse_impossible_transitions
from motion_detect_ros.bridge.params import LiveParameters, declare_simple, warn_of_unknown_parameters
from motion_detect_ros.bridge.qos import best_effort, diagnostics_qos, incompatibility, overridable
from motion_detect_ros.bridge.shared_memory import give_up_dead_ports
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.secrets import reason_of

DIAGNOSTICS_PERIOD_S = 1.0
#: How often the node looks whether things have become worse, which is reported at once, seconds.
WATCH_PERIOD_S = 0.2
#: How often it looks for ports of killed processes, which are to be given up before these start again, seconds.
PORTS_PERIOD_S = 1.0
#: How long who requested a shutdown gets for its answer and a look at the state before the process ends, seconds.
SHUTDOWN_LINGER_S = 0.5
#: Seconds between two warnings about the same thing.
WARNING_PERIOD_S = 5.0


class ManagedNode(LifecycleNode):
    """A lifecycle node that starts by itself unless ``autostart`` is false.

    A subclass overrides ``open`` (resources, warm-up), ``begin`` (subscriptions, timers, threads), ``end`` and
    ``reset``. While ``opening`` is true ``open`` runs, which may be interrupted at any point. ``finished`` ends the
    process with ``exit_code`` when it is set.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.live = LiveParameters(self)
        self.stats = StageStats()
        self.finished: Future = Future()
        self.exit_code = 0
        self._failure = self._opened = ''
        self._starting = False
        self._autostart = bool(declare_simple(self, 'autostart', True, 'configure and activate at start'))
        self._subscriptions_made: list[Any] = []
        #: Topic -> why messages of a publisher of it do not arrive.
        self.incompatible: dict[str, str] = {}
        self._heard: set[str] = set()
        self._to_relax: list[Callable[[], None]] = []
        self._publishers_made: list[LifecyclePublisher] = []
        self.configured = False
        self.opening = False
        self.active = False
        self._reporter = Reporter(self.get_fully_qualified_name(), self.get_name(), self.stats)
        self._reports = self.create_publisher(DiagnosticArray, '/diagnostics', diagnostics_qos())
        self.every(DIAGNOSTICS_PERIOD_S, self.report)
        self.every(WATCH_PERIOD_S, self._watch)
        self.every(PORTS_PERIOD_S, give_up_dead_ports)
        self.create_service(Trigger, '~/reset', self._on_reset)
        refuse_impossible_transitions(self)

    def start(self) -> None:
        """Configure and activate, where ``autostart`` says so. Raises: SourceError where that fails."""
        self._starting = self._autostart
        for transition in (self.trigger_configure, self.trigger_activate) if self._autostart else ():
            if transition() != TransitionCallbackReturn.SUCCESS:
                raise SourceError(self._failure or f'{self.get_name()}: does not start')
        self._starting = False

    def open(self) -> None:
        """Make what outlives an activation: stages, publishers."""

    def begin(self) -> None:
        """Start working."""

    def end(self) -> None:
        """Stop working; ``begin`` may come again."""

    def reset(self) -> None:
        """Forget history."""

    def condition(self) -> Condition:
        """What is not as it should be, or why nothing happens, while active."""
        return Condition()

    def extra_diagnostics(self) -> tuple[tuple[str, str], ...]:
        """More key-value pairs for ``/diagnostics``."""
        return ()

    def now_ns(self) -> int:
        """Time of the node's clock."""
        return int(self.get_clock().now().nanoseconds)

    def bad_input(self, error: Exception) -> None:
        """An input that cannot be used costs itself and nothing else."""
        self.stats.count_error(str(error))
        self.get_logger().warning(f'input left out: {error}', throttle_duration_sec=WARNING_PERIOD_S)

    def every(self, period_s: float, action: Callable[[], object]) -> None:
        """Calls ``action`` in the executor every ``period_s`` of steady time, whatever the simulated clock does."""
        self.create_timer(period_s, action, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def subscribe(
        self, kind: Any, name: str, callback: Callable[[Any], None], quality: QoSProfile, relax: bool = False,
        **options: Any,
    ) -> None:
        """A subscription that lives until deactivation; publishers it is incompatible with are named.

        relax: where a publisher is best effort, and the subscription reliable, that becomes best effort too.
        """
        topic = self.resolve_topic_name(name)

        def noted(msg: Any) -> None:
            self._heard.add(name)
            callback(msg)

        def on_incompatible(event: Any) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind)
            if relax and policy == 'RELIABILITY':  # not here: the event belongs to the subscription
                self._to_relax.append(relaxed)
                return
            self.incompatible[topic] = incompatibility(topic, policy, quality)
            self.get_logger().warning(self.incompatible[topic], throttle_duration_sec=WARNING_PERIOD_S)

        made = self.create_subscription(
            kind, name, noted, quality, event_callbacks=SubscriptionEventCallbacks(incompatible_qos=on_incompatible),
            **options)
        self._subscriptions_made.append(made)

        def relaxed() -> None:
            if made in self._subscriptions_made:
                self._subscriptions_made.remove(made)
                self.destroy_subscription(made)
                self.subscribe(kind, name, callback, best_effort(made.qos_profile))
                self.get_logger().info(f'{topic} has a best-effort publisher: subscribed best effort')

    def serve(self, name: str, action: Callable[[], str]) -> None:
        """A service without arguments that runs ``action`` in the executor and answers with its words."""
        def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = True, action()
            return response

        self.create_service(Trigger, name, answer)

    def gone(self, names: Iterable[str]) -> str:
        """In a few words which of these topics had messages and have no publisher any more; empty where none."""
        lost = [name for name in names
                if name in self._heard and not self.count_publishers(self.resolve_topic_name(name))]
        return f'no publisher of {", ".join(lost)} any more' if lost else ''

    def unsubscribe(self) -> None:
        """End all subscriptions made by ``subscribe``."""
        self.incompatible.clear()
        self._to_relax.clear()
        while self._subscriptions_made:
            self.destroy_subscription(self._subscriptions_made.pop())

    def advertise(self, kind: Any, name: str, quality: QoSProfile) -> LifecyclePublisher:
        """A publisher, silent while inactive, that lives until clean-up."""
        publisher = self.create_lifecycle_publisher(kind, name, quality, qos_overriding_options=overridable())
        self._publishers_made.append(publisher)
        return publisher

    def _withdraw(self) -> None:
        while self._publishers_made:
            self.destroy_lifecycle_publisher(self._publishers_made.pop())

    def close(self) -> None:
        """End whatever runs; safe to call at any time."""
        self._leave()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle: inactive from now on."""
        start_s = time.monotonic()
        warn_of_unknown_parameters(self)
        self.opening = True
        result = self._attempt(self.open)
        self.opening = False
        self.configured = result == TransitionCallbackReturn.SUCCESS
        if not self.configured:
            self._withdraw()
            return result
        self._opened = f'configured in {time.monotonic() - start_s:.1f} s'
        if not self._starting:
            self.get_logger().info(self._opened)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle: working from now on."""
        super().on_activate(state)
        result = self._attempt(self.begin)
        self.active = result == TransitionCallbackReturn.SUCCESS
        if not self.active:
            self._leave()
            super().on_deactivate(state)
            return result
        how = f'{self._opened}, ' if self._starting else ''
        self.get_logger().info(f'{how}active: subscribes to {endpoints(self._subscriptions_made)}; '
                               f'publishes {endpoints(self._publishers_made)}')
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle: idle from now on."""
        self._leave()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle: as if just made."""
        result = super().on_cleanup(state)
        self.configured = False
        self._withdraw()
        return result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle: over; the process ends as soon as who requested it has the answer."""
        self._leave()
        self.configured = False
        self.every(SHUTDOWN_LINGER_S, self._finish)
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """Leave the network."""
        super().destroy_node()
        destroy_states(self)

    def _finish(self) -> None:
        if not self.finished.done():
            self.finished.set_result(None)

    def fail(self, error: Exception, quiet: bool = False) -> None:
        """Log why the node cannot work, unless ``quiet``; diagnostics are ERROR until it starts again."""
        self._failure = reason_of(error)
        self.stats.count_error(self._failure)
        if self.context.ok() and not quiet:
            self.get_logger().error(self._failure)

    def _attempt(self, action: Any) -> TransitionCallbackReturn:
        self._failure = ''
        try:
            action()
        except Exception as error:  # rclpy would swallow it
            self.fail(error, quiet=self._starting)  # the process ends with this line
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def _leave(self) -> None:
        self.active = False
        self.unsubscribe()
        self._heard.clear()
        self.end()

    def report(self) -> None:
        """Publish ``/diagnostics`` now."""
        stamp = self.get_clock().now().to_msg()
        self._reports.publish(self._reporter.report(
            time.monotonic_ns(), self._judged(), stamp, (*self.extra_diagnostics(), *self._subscribers())))

    def _subscribers(self) -> tuple[tuple[str, str], ...]:
        return tuple((f'{SUBSCRIBERS_OF}{publisher.topic_name}', str(publisher.get_subscription_count()))
                     for publisher in self._publishers_made)

    def _watch(self) -> None:
        while self._to_relax:
            self._to_relax.pop(0)()
        if self._reporter.worse(time.monotonic_ns(), self._judged()):
            self.report()

    def _judged(self) -> Condition:
        if self._failure:
            return Condition(fault=self._failure)
        return self.condition() if self.active else Condition(idle='inactive')

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.configured:
            self.reset()
        response.success = self.configured
        response.message = 'history cleared' if self.configured else 'expected a configured node, nothing to clear'
        return response
