"""Bearings in the frames of PX4 and ArduPilot: body FRD (forward, right, down) and world NED (north, east, down).

    python3 autopilot_frames.py --ros-args -p camera_pitch_deg:=30.0 -r imu/data:=/mavros/imu/data \
        -r obstacles:=/mavros/obstacle/send

Subscribes to ``detections`` and ``imu/data`` (sensor_msgs/Imu with the attitude as MAVROS gives it: FLU body in ENU
world, REP 103). Publishes for each image ``~/bearings_ned`` (sensor_msgs/PointCloud2: north, east, down float32, unit
rays, and id) and ``obstacles`` (sensor_msgs/LaserScan for MAVROS' obstacle_distance, with mav_frame BODY_FRD).

The four frames: the optical one of our bearings is x right, y down, z forward. FRD is the autopilot's body, NED its
world. REP 103, and with it MAVROS towards ROS, uses FLU (forward, left, up) and ENU (east, north, up).

``obstacles`` has 72 sectors of 5 degrees, clockwise from the nose as MAVLink's OBSTACLE_DISTANCE wants them. Sectors
with a moving object hold the horizontal share of the ASSUMED distance ``range_m`` (one camera measures none), all
others NaN = unknown: they may hold a wall. What is more than 60 degrees above or below the vehicle stands in no sector.
The camera looks along the nose, ``camera_pitch_deg`` below it. Frames are named as MAVROS names them.
"""

import math
from collections import deque

import numpy as np
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu, LaserScan, PointCloud2
from std_msgs.msg import Header

from motion_detect_ros.bridge.params import declare_simple
from motion_detect_ros.bridge.records import read_detections, records_to_msg
from motion_detect_ros.bridge.runner import run_plain

SECTORS = 72
#: Distances that a scan may hold, metres.
LIMITS_M = 0.1, 100.0
#: What is so far above or below is not beside the vehicle, degrees.
STEEP_DEG = 60.0
#: MAVROS' names of the body and the world of the autopilot.
BODY, WORLD = 'base_link_frd', 'map_ned'
#: An attitude further away in time than this is not that of the image, seconds; how many are kept.
NEAR_S, KEPT = 0.1, 400
NED = np.dtype([('north', '<f4'), ('east', '<f4'), ('down', '<f4'), ('id', '<u4')])


def optical_to_frd(rays, camera_pitch_deg=0.0):
    """(n, 3) optical rays as (n, 3) FRD; the camera looks along the nose, so far below it."""
    right, down, forward = np.moveaxis(np.asarray(rays, np.float64), -1, 0)
    cos, sin = math.cos(math.radians(camera_pitch_deg)), math.sin(math.radians(camera_pitch_deg))
    return np.stack([cos * forward - sin * down, right, sin * forward + cos * down], axis=-1)


def rotation_of(w, x, y, z):
    """(3, 3) matrix of a unit quaternion, Hamilton's convention as PX4, MAVLink and ROS use it."""
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                     [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                     [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def frd_to_ned(rays, frd_in_ned):
    """(n, 3) FRD rays as (n, 3) NED; frd_in_ned: PX4's VehicleAttitude.q or MAVLink's ATTITUDE_QUATERNION, w first."""
    return np.asarray(rays) @ rotation_of(*frd_in_ned).T


def frd_to_ned_by_ros(rays, flu_in_enu):
    """(n, 3) FRD rays as (n, 3) NED; flu_in_enu: attitude as ROS and MAVROS give it, w first."""
    east, north, up = np.moveaxis((np.asarray(rays) * (1, -1, -1)) @ rotation_of(*flu_in_enu).T, -1, 0)
    return np.stack([north, east, -up], axis=-1)


def sectors_of(frd, range_m):
    """(72,) horizontal distances in metres of objects at ``range_m``, NaN where none is: sector k is centred 5 k
    degrees clockwise from the nose. frd: (n, 3) unit rays.
    """
    ranges = np.full(SECTORS, np.nan)
    level = np.hypot(frd[:, 0], frd[:, 1])
    beside = level > math.cos(math.radians(STEEP_DEG))
    degrees = np.degrees(np.arctan2(frd[beside, 1], frd[beside, 0]))
    np.fmin.at(ranges, np.round(degrees * SECTORS / 360).astype(int) % SECTORS, range_m * level[beside])
    return ranges


def attitude_at(attitudes, when_s):
    """The nearest in time of (stamp in s, attitude) and '', or None and why there is none."""
    if not attitudes:
        return None, 'no attitude on imu/data so far'
    stamp_s, attitude = min(attitudes, key=lambda one: abs(one[0] - when_s))
    if (away_s := abs(stamp_s - when_s)) > NEAR_S:
        return None, f'no attitude within {NEAR_S:g} s of the image: the nearest is {away_s:.1f} s away'
    return attitude, ''


class AutopilotFrames(Node):
    """Answers each detections message in the frames of the autopilot."""

    def __init__(self):
        super().__init__('autopilot_frames')
        self.camera_pitch_deg = declare_simple(self, 'camera_pitch_deg', 0.0, 'below the nose', -90.0, 90.0)
        self.range_m = declare_simple(self, 'range_m', 5.0, 'assumed distance', *LIMITS_M)
        self.attitudes = deque(maxlen=KEPT)
        self.bearings = self.create_publisher(PointCloud2, '~/bearings_ned', 5)
        self.scans = self.create_publisher(LaserScan, 'obstacles', 5)
        self.create_subscription(Imu, 'imu/data', self.on_imu, qos_profile_sensor_data)
        self.create_subscription(PointCloud2, 'detections', self.on_detections, 5)

    def on_imu(self, msg):
        """Keep attitudes: images are older than they. -1 in the covariance says that there is none."""
        if msg.orientation_covariance[0] == -1:
            return
        q = msg.orientation
        self.attitudes.append((seconds(msg.header), (q.w, q.x, q.y, q.z)))

    def on_detections(self, msg):
        """One image, in both frames."""
        everything = read_detections(msg)
        detections = everything[np.isfinite(everything['bearing_z'])]
        if len(detections) < len(everything):
            self.get_logger().warning('objects without bearings: camera_info is missing or all zero, or they are where '
                                      'the lens has no ray', throttle_duration_sec=5.0)
        frd = optical_to_frd(np.stack([detections[f'bearing_{axis}'] for axis in 'xyz'], axis=-1),
                             self.camera_pitch_deg)
        self.scans.publish(LaserScan(
            header=Header(stamp=msg.header.stamp, frame_id=BODY), range_min=LIMITS_M[0], range_max=LIMITS_M[1],
            angle_min=0.0, angle_increment=2 * math.pi / SECTORS, angle_max=2 * math.pi * (SECTORS - 1) / SECTORS,
            ranges=sectors_of(frd, self.range_m).tolist()))
        when = seconds(msg.header)
        attitude, reason = attitude_at(self.attitudes, when)
        if attitude is None:
            return self.get_logger().warning(reason, throttle_duration_sec=5.0)
        records = np.zeros(len(detections), NED)
        records['north'], records['east'], records['down'] = frd_to_ned_by_ros(frd, attitude).T
        records['id'] = detections['id']
        self.bearings.publish(records_to_msg(records, Header(stamp=msg.header.stamp, frame_id=WORLD)))


def seconds(header):
    """Stamp of a header, s."""
    return header.stamp.sec + 1e-9 * header.stamp.nanosec


if __name__ == '__main__':
    run_plain(AutopilotFrames)
