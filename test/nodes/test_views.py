"""The layouts for RViz and Foxglove name topics that a running overlay publishes, with their types."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

CONFIG = Path(__file__).resolve().parents[2] / 'config'
#: Plugin of rviz_default_plugins, panel of Foxglove -> what they show.
SHOWN_BY = {
    'rviz_default_plugins/Image': 'sensor_msgs/msg/Image', 'Image': 'sensor_msgs/msg/Image',
    'rviz_default_plugins/MarkerArray': 'visualization_msgs/msg/MarkerArray',
    '3D': 'visualization_msgs/msg/MarkerArray',
    'DiagnosticSummary': 'diagnostic_msgs/msg/DiagnosticArray', 'RawMessages': 'sensor_msgs/msg/PointCloud2',
}
RELIABILITY, DURABILITY = 'Reliable', 'Volatile'


def shown_in_rviz() -> dict[str, str]:
    displays = yaml.safe_load((CONFIG / 'motion_detect.rviz').read_text())['Visualization Manager']['Displays']
    shown = [each for each in displays if 'Topic' in each]
    assert {(each['Topic']['Reliability Policy'], each['Topic']['Durability Policy']) for each in shown} == {
        (RELIABILITY, DURABILITY)}
    return {each['Topic']['Value']: SHOWN_BY[each['Class']] for each in shown}


def shown_in_foxglove() -> dict[str, str]:
    layout = json.loads((CONFIG / 'foxglove_layout.json').read_text())
    assert panels(layout['layout']) == set(layout['configById'])
    return {topic: SHOWN_BY[name.partition('!')[0]] for name, panel in layout['configById'].items()
            for topic in topics_of(panel)}


def panels(node: Any) -> set[str]:
    return {node} if isinstance(node, str) else panels(node['first']) | panels(node['second'])


def topics_of(panel: dict[str, Any]) -> list[str]:
    named = (panel.get('imageMode', {}).get('imageTopic'), panel.get('topicToRender'), panel.get('topicPath'))
    return [*filter(None, named), *panel.get('topics', {})]


def test_what_the_views_show_is_published(peer, start):
    start('overlay')
    start('art2_clustering', '-p', 'preprocessing.max_width_px:=320')
    wanted = shown_in_rviz() | shown_in_foxglove()
    assert {'/overlay/overlay', '/overlay/markers', '/diagnostics', '/detections'} <= set(wanted)

    def published() -> dict[str, str]:
        return {name: kinds[0] for name, kinds in peer.node.get_topic_names_and_types()
                if peer.node.count_publishers(name)}

    assert peer.until(lambda: set(wanted) <= set(published()), 120.0), set(wanted) - set(published())
    assert wanted == {name: kind for name, kind in published().items() if name in wanted}
