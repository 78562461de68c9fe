"""Everything about bags under one name: reading, writing, and their pictures as a frame source."""

from motion_detect_ros.sources.bag_frames import BagFrames
from motion_detect_ros.sources.bag_reader import METADATA_NAME, BagReader, is_bag, is_recording
from motion_detect_ros.sources.bag_writer import BagWriter
from motion_detect_ros.sources.raw import RawMessage, TopicInfo

__all__ = ['METADATA_NAME', 'BagFrames', 'BagReader', 'BagWriter', 'RawMessage', 'TopicInfo', 'is_bag', 'is_recording']
