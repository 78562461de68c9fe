"""Where a node subscribes to images, as the user remaps them."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

import rclpy
from rclpy.context import Context

from motion_detect_ros.bridge.image_input import ImageInput
from motion_detect_ros.cli.domains import own_domain


@pytest.mark.parametrize(('transport', 'rules', 'topic'), [
    ('raw', [], '/robot/image_raw'),
    ('raw', ['image_raw:=/front/image'], '/front/image'),
    ('compressed', [], '/robot/image_raw/compressed'),
    ('compressed', ['image_raw:=/front/image'], '/front/image/compressed'),
    ('compressed', ['image_raw:=image'], '/robot/image/compressed'),
    ('compressed', ['image_raw/compressed:=/jpeg'], '/jpeg'),
    ('compressed', ['image_raw:=/front/image', 'image_raw/compressed:=/jpeg'], '/jpeg'),
])
def test_compressed_images_are_beside_the_raw_ones(transport: str, rules: list[str], topic: str):
    context = Context()
    rclpy.init(context=context, domain_id=own_domain())
    words = ['--ros-args', '-p', f'image_transport:={transport}', *(word for rule in rules for word in ('-r', rule))]
    node = rclpy.create_node('stage', namespace='robot', context=context, cli_args=words)
    try:
        assert node.resolve_topic_name(ImageInput.declared(node).topic.name) == topic
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
