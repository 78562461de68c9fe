"""Reads a bag with ``detections`` without ROS and without this package: ``pip install rosbags numpy`` is enough.

    python3 read_detections_mcap.py out/detections.mcap > objects.csv

Works on detections.mcap of ``replay`` and ``demo`` and on what ``ros2 bag record detections`` has written.
"""

import os
import sys
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

#: sensor_msgs/PointField: datatype -> numpy.
KINDS = {1: 'i1', 2: 'u1', 3: '<i2', 4: '<u2', 5: '<i4', 6: '<u4', 7: '<f4', 8: '<f8'}


def records_of(cloud):
    """The points of a PointCloud2 as a structured array, with the message's own fields."""
    layout = {'names': [field.name for field in cloud.fields], 'formats': [KINDS[f.datatype] for f in cloud.fields],
              'offsets': [field.offset for field in cloud.fields], 'itemsize': cloud.point_step}
    return np.frombuffer(cloud.data, np.dtype(layout), cloud.width)


def objects_in(bag, topic='detections'):
    """(stamp in ns, record) of every object, message by message; bag: MCAP file or folder of a bag."""
    with AnyReader([Path(bag)], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = [connection for connection in reader.connections if connection.topic.lstrip('/') == topic]
        if not wanted:
            raise AnyReaderError(f'expected a topic {topic}, got {", ".join(sorted(reader.topics)) or "none"}')
        for connection, _, data in reader.messages(connections=wanted):
            cloud = reader.deserialize(data, connection.msgtype)
            stamp_ns = cloud.header.stamp.sec * 1_000_000_000 + cloud.header.stamp.nanosec
            for record in records_of(cloud):
                yield stamp_ns, record


def wrong(words):
    """Say it and end."""
    print(f'read_detections_mcap: {words}', file=sys.stderr)
    sys.exit(2)


def main():
    """One line for each object: corner and size of the box as ``evaluate`` and MOTChallenge want them."""
    if len(sys.argv) != 2:
        wrong(f'expected one bag, got {len(sys.argv) - 1} arguments')
    try:
        objects = list(objects_in(sys.argv[1]))
    except (FileNotFoundError, AnyReaderError) as error:
        wrong(f'{sys.argv[1]}: {error}')
    try:
        print('stamp_ns,id,x,y,w,h,score')
        for stamp_ns, one in objects:
            width, height = one['width'], one['height']
            left, top = one['u'] - width / 2, one['v'] - height / 2
            print(f'{stamp_ns},{one["id"]},{left:.2f},{top:.2f},{width:.2f},{height:.2f},{one["score"]:.4f}')
        sys.stdout.flush()
    except BrokenPipeError:  # who reads this, as head does, has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == '__main__':
    main()
