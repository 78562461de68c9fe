"""More pictures than a node can take: it leaves some out, the answers stay young."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from motion_detect_ros.benchmarks.bench_nodes import NodeProcesses
from motion_detect_ros.benchmarks.bench_transport import await_nodes, feed, pictures
from motion_detect_ros.benchmarks.feeder import Feeder
from motion_detect_ros.cli.live import own_domain

RATE_HZ, PICTURES = 60.0, 240
#: Flow at full resolution: more than any machine computes at that rate.
HEAVY = ('optical_flow.finest_scale:=0',)


def overloaded(nodes: tuple[str, ...], *parameters: str) -> tuple[list[float], dict[str, str], int]:
    """Latencies in order, the last report of the last node, and how many pictures were sent."""
    domain = own_domain()
    with Feeder(domain, pictures(), RATE_HZ) as feeder, NodeProcesses(nodes, domain, parameters) as processes:
        await_nodes(feeder, processes, len(nodes))
        before = feeder.sent
        answers = feed(feeder, processes, PICTURES)
        return [answer.latency_ms for answer in answers], feeder.diagnostics(nodes[-1]), feeder.sent - before


@pytest.mark.parametrize('nodes', [('pipeline',), ('ego_motion', 'optical_flow', 'art2_clustering')],
                         ids=['pipeline', 'four nodes'])
def test_overload_costs_pictures_not_time(nodes):
    latencies, report, sent = overloaded(nodes, *HEAVY)
    compute_ms = float(report['latency_p50_ms'])
    assert len(latencies) < 0.9 * sent  # it was an overload
    half = len(latencies) // 2
    first, second = sorted(latencies[:half]), sorted(latencies[half:])
    assert second[half // 2] < 2.0 * first[half // 2]
    assert second[half // 2] < len(nodes) * 8.0 * max(compute_ms, 20.0)
    assert int(report['dropped']) > 0


def test_a_long_mailbox_is_what_makes_answers_old():
    """The same without the short mailbox: the test above can fail."""
    latencies, _, _ = overloaded(('pipeline',), 'queue_size:=1000', *HEAVY)
    quarter = len(latencies) // 4
    assert sorted(latencies[-quarter:])[quarter // 2] > 3.0 * sorted(latencies[:quarter])[quarter // 2]


def test_m_of_n_pictures_are_answered_and_none_counts_as_dropped():
    domain, nodes = own_domain(), ('ego_motion', 'optical_flow', 'art2_clustering')
    small = ('preprocessing.max_width_px:=240', 'load.decimation_keep:=2', 'load.decimation_of:=5')
    with Feeder(domain, pictures(480, 270), 10.0) as feeder, NodeProcesses(nodes, domain, small) as processes:
        await_nodes(feeder, processes, len(nodes))
        before = feeder.sent
        answers = feed(feeder, processes, 40)
        assert len(answers) == pytest.approx(0.4 * (feeder.sent - before), abs=2)
        assert [feeder.diagnostics(node)['dropped'] for node in nodes] == ['0', '0', '0']
