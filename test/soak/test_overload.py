"""More pictures than a node can take: it leaves some out, the answers stay young."""

from __future__ import annotations

import time
from contextlib import ExitStack
from statistics import median

import pytest

pytest.importorskip('rclpy')

from motion_detect_ros.benchmarks.bench_nodes import NodeProcesses
from motion_detect_ros.benchmarks.bench_timing import flight
from motion_detect_ros.benchmarks.bench_transport import await_nodes, feed, pictures, settle
from motion_detect_ros.benchmarks.feeder import Answer, Feeder
from motion_detect_ros.cli.domains import DOMAINS, own_domain
from motion_detect_ros.sources.synthetic import FlightConfig

RATE_HZ, PICTURES = 60.0, 480
#: Of 25 MB each.
PICTURES_4K = 12
#: Flow at full resolution: more than any machine computes at that rate.
HEAVY = ('optical_flow.finest_scale:=0',)


#: A camera of 3840 x 2160, and eight small ones on one machine; at this rate each.
FAST_HZ, CAMERAS, SECONDS = 30.0, 8, 20.0


def overloaded(nodes: tuple[str, ...], *parameters: str) -> tuple[list[float], list[dict[str, str]], int]:
    """Latencies in order, the last report of every node, and how many pictures were sent."""
    domain = own_domain()
    with Feeder(domain, pictures(), RATE_HZ) as feeder, NodeProcesses(nodes, domain, parameters) as processes:
        await_nodes(feeder, processes, len(nodes))
        before = feeder.sent
        answers = feed(feeder, processes, PICTURES)
        reports = [feeder.diagnostics(node) for node in nodes]
        return [answer.latency_ms for answer in answers], reports, feeder.sent - before


@pytest.mark.timing
@pytest.mark.parametrize('nodes', [('pipeline',), ('ego_motion', 'optical_flow', 'art2_clustering')],
                         ids=['pipeline', 'four nodes'])
def test_overload_costs_pictures_not_time(nodes):
    latencies, reports, sent = overloaded(nodes, *HEAVY)
    compute_ms = sum(max(20.0, float(report['latency_p50_ms'])) for report in reports)
    assert len(latencies) < 0.9 * sent  # it was an overload
    half = len(latencies) // 2
    first, second = median(latencies[:half]), median(latencies[half:])
    assert second < 2.0 * first
    assert second < 8.0 * compute_ms
    assert sum(int(report['dropped']) for report in reports) > 0


@pytest.mark.soak
def test_a_long_mailbox_is_what_makes_answers_old():
    """The same without the short mailbox: the test above can fail."""
    latencies, _, _ = overloaded(('pipeline',), 'queue_size:=1000', *HEAVY)
    quarter = len(latencies) // 4
    assert sorted(latencies[-quarter:])[quarter // 2] > 3.0 * sorted(latencies[:quarter])[quarter // 2]


def halves(answers: list[Answer]) -> tuple[float, float]:
    """Median latencies of the first and of the second half, ms."""
    latencies = [answer.latency_ms for answer in answers]
    half = len(latencies) // 2
    return median(latencies[:half]), median(latencies[half:])


@pytest.mark.soak
def test_a_camera_of_4k_at_30_hz_costs_pictures_not_time(shown):
    domain = own_domain()
    images = [image for image, _ in flight(FlightConfig(width=3840, height=2160, frames=PICTURES_4K))]
    with Feeder(domain, images, FAST_HZ) as feeder, \
            NodeProcesses(('pipeline',), domain) as processes:
        await_nodes(feeder, processes, 1)
        answers = feed(feeder, processes, round(SECONDS * FAST_HZ))
        compute_ms = float(feeder.diagnostics('pipeline')['latency_p50_ms'])
    first, second = halves(answers)
    assert len(answers) > SECONDS
    assert second < 2.0 * first
    assert second < 8.0 * compute_ms
    shown('a camera of 3840x2160 at 30 Hz', 'pictures are left out, the answers stay young',
          f'{len(answers) / SECONDS:.0f} answers a second, median age {first:.0f} ms, then {second:.0f} ms')


@pytest.mark.soak
def test_eight_cameras_on_one_machine_cost_pictures_not_time(shown):
    """Each in a graph of its own."""
    images = pictures(640, 360)
    with ExitStack() as stack:
        pairs = []
        for number in range(CAMERAS):
            domain = DOMAINS[(own_domain() + number) % len(DOMAINS)]
            feeder = stack.enter_context(Feeder(domain, images, FAST_HZ))
            pairs.append((feeder, stack.enter_context(NodeProcesses(('pipeline',), domain, ('load.threads:=1',)))))
        for feeder, processes in pairs:
            await_nodes(feeder, processes, 1)
        for feeder, _ in pairs:
            feeder.go()
        time.sleep(SECONDS)
        found = [(halves(settle(feeder)), feeder.diagnostics('pipeline')) for feeder, _ in pairs]
    assert all(second < 2.0 * first for (first, second), _ in found)
    assert all(int(report['dropped']) > 0 for _, report in found)
    seconds = [second for (_, second), _ in found]
    shown('eight cameras of 640x360 at 30 Hz, each with its pipeline, on one machine',
          'pictures are left out, the answers stay young', f'median ages {min(seconds):.0f} to {max(seconds):.0f} ms')
