"""More pictures than a node can take: it leaves some out, the answers stay young."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from motion_detect_ros.benchmarks.bench_nodes import NodeProcesses
from motion_detect_ros.benchmarks.bench_transport import await_nodes, feed, pictures
from motion_detect_ros.benchmarks.feeder import Feeder
from motion_detect_ros.cli.live import own_domain

pytestmark = pytest.mark.timing

RATE_HZ, PICTURES = 60.0, 240
#: Flow at full resolution: more than any machine computes at that rate.
HEAVY = ('optical_flow.finest_scale:=0',)


def overloaded(nodes: tuple[str, ...], *parameters: str) -> tuple[list[float], list[dict[str, str]], int]:
    """Latencies in order, the last report of every node, and how many pictures were sent."""
    domain = own_domain()
    with Feeder(domain, pictures(), RATE_HZ) as feeder, NodeProcesses(nodes, domain, parameters) as processes:
        await_nodes(feeder, processes, len(nodes))
        before = feeder.sent
        answers = feed(feeder, processes, PICTURES)
        reports = [feeder.diagnostics(node) for node in nodes]
        return [answer.latency_ms for answer in answers], reports, feeder.sent - before


@pytest.mark.parametrize('nodes', [('pipeline',), ('ego_motion', 'optical_flow', 'art2_clustering')],
                         ids=['pipeline', 'four nodes'])
def test_overload_costs_pictures_not_time(nodes):
    latencies, reports, sent = overloaded(nodes, *HEAVY)
    compute_ms = sum(max(20.0, float(report['latency_p50_ms'])) for report in reports)
    assert len(latencies) < 0.9 * sent  # it was an overload
    half = len(latencies) // 2
    first, second = sorted(latencies[:half]), sorted(latencies[half:])
    assert second[half // 2] < 2.0 * first[half // 2]
    assert second[half // 2] < 8.0 * compute_ms
    assert sum(int(report['dropped']) for report in reports) > 0


def test_a_long_mailbox_is_what_makes_answers_old():
    """The same without the short mailbox: the test above can fail."""
    latencies, _, _ = overloaded(('pipeline',), 'queue_size:=1000', *HEAVY)
    quarter = len(latencies) // 4
    assert sorted(latencies[-quarter:])[quarter // 2] > 3.0 * sorted(latencies[:quarter])[quarter // 2]
