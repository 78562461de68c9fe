"""Everything about bags under one name: reading, writing, and their pictures as a frame source."""

from motion_detect_ros.sources.bag_frames import BagFrames
from motion_detect_ros.sources.bag_reader import BagReader, is_bag
from motion_detect_ros.sources.bag_writer import PART_SUFFIX, BagWriter
from motion_detect_ros.sources.raw import RawMessage, TopicInfo

__all__ = ['PART_SUFFIX', 'BagFrames', 'BagReader', 'BagWriter', 'RawMessage', 'TopicInfo', 'is_bag']
