"""Whether a planner may trust the detector right now: silence, WARN and ERROR all mean that it does not work."""

from __future__ import annotations

import time
from collections.abc import Collection
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from motion_detect_ros.bridge.topics import DETECTIONS, DIAGNOSTICS
from motion_detect_ros.core.errors import ConfigError

#: Silence on ``detections`` that is too long where the planner says nothing else; reports come once a second: seconds.
DETECTIONS_S, REPORTS_S = 0.5, 2.5


class Watchdog:
    """Listens to ``detections`` and to the health of the stages behind them, on a node of the planner's."""

    def __init__(
        self, node: Node, stages: Collection[str] = ('/pipeline',), detections_s: float = DETECTIONS_S,
    ) -> None:
        """stages: full names of the nodes that must be well; detections_s: longest silence, some camera periods.

        Raises: ConfigError for stages that are no full names: none of these would ever report.
        """
        if isinstance(stages, str) or not all(name.startswith('/') for name in stages):
            raise ConfigError(f"stages: expected full names of nodes, such as ['/pipeline'], got {stages!r}")
        self._detections_s = detections_s
        self._heard_s = -float('inf')
        self._reports: dict[str, tuple[float, DiagnosticStatus | None]] = dict.fromkeys(stages, (-float('inf'), None))
        node.create_subscription(DETECTIONS.kind, DETECTIONS.name, self._on_detections, DETECTIONS.qos())
        node.create_subscription(DIAGNOSTICS.kind, DIAGNOSTICS.name, self._on_reports, DIAGNOSTICS.qos())

    def trouble(self) -> str:
        """Why the detector is not to be trusted now, in a few words; empty where it is."""
        now_s = time.monotonic()
        for stage, (heard_s, status) in self._reports.items():
            if status is None or now_s - heard_s > REPORTS_S:
                return f'{stage}: no report'
            if status.level != DiagnosticStatus.OK:
                return f'{stage}: {status.message}'
        return '' if now_s - self._heard_s <= self._detections_s else 'no detections'

    def _on_detections(self, _msg: Any) -> None:
        self._heard_s = time.monotonic()

    def _on_reports(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            if status.name in self._reports:
                self._reports[status.name] = time.monotonic(), status
