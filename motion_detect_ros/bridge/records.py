"""Structured arrays <-> PointCloud2: the ``ego_motion`` and ``detections`` topics."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from motion_detect_ros.bridge.images import bytes_of, stamp_ns
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.core.types import DETECTION_DTYPE, NANOSECONDS, EgoMotion, EgoStatus, MotionModel, RecordArray

#: Row and column of the upper triangle of a 6 x 6 matrix, in row order: c00 .. c20.
UPPER = np.triu_indices(6)
EGO_DTYPE = np.dtype(
    [(f'm{r}{c}', '<f8') for r in range(3) for c in range(3)]
    + [(f'c{i:02d}', '<f8') for i in range(len(UPPER[0]))]
    + [('dt', '<f8'), ('inliers', '<u4'), ('tracks', '<u4'), ('residual', '<f4'), ('model', 'u1'), ('status', 'u1'),
       ('prev_sec', '<u4'), ('prev_nanosec', '<u4')])

_DATATYPES = {
    'i1': PointField.INT8, 'u1': PointField.UINT8, 'i2': PointField.INT16, 'u2': PointField.UINT16,
    'i4': PointField.INT32, 'u4': PointField.UINT32, 'f4': PointField.FLOAT32, 'f8': PointField.FLOAT64,
}
_FORMATS = {datatype: name for name, datatype in _DATATYPES.items()}


def records_to_msg(records: RecordArray, header: Header) -> PointCloud2:
    """Any flat structured array as an unordered cloud, one record a point."""
    dtype = records.dtype
    fields = [PointField(name=name, offset=dtype.fields[name][1], datatype=_DATATYPES[dtype[name].str[1:]], count=1)
              for name in dtype.names]
    return PointCloud2(
        header=header, height=1, width=len(records), fields=fields, is_bigendian=False, point_step=dtype.itemsize,
        row_step=dtype.itemsize * len(records), data=bytes_of(records.view(np.uint8)), is_dense=True)


def records_from_msg(msg: PointCloud2, dtype: np.dtype[np.void]) -> RecordArray:
    """The message's points as ``dtype``, found by field name; fields that ``dtype`` does not have are left out.

    Raises: MessageError where a field is missing or the data are shorter than promised.
    """
    order = '>' if msg.is_bigendian else '<'
    layout = np.dtype({
        'names': [field.name for field in msg.fields],
        'formats': [order + _FORMATS.get(field.datatype, 'u1') for field in msg.fields],
        'offsets': [field.offset for field in msg.fields],
        'itemsize': msg.point_step,
    })
    missing = [name for name in dtype.names or () if name not in (layout.names or ())]
    if missing:
        raise MessageError(f'records: expected fields {", ".join(missing)}, got {", ".join(layout.names or ())}')
    count, data = msg.width * msg.height, np.frombuffer(msg.data, np.uint8)
    if data.size < count * msg.point_step:
        raise MessageError(f'records: expected {count * msg.point_step} bytes, got {data.size}')
    source = data[:count * msg.point_step].view(layout)
    records = np.empty(count, dtype)
    for name in dtype.names or ():
        records[name] = source[name]
    return records


def detections_to_msg(records: RecordArray, header: Header) -> PointCloud2:
    """The ``detections`` topic. records: dtype ``DETECTION_DTYPE``."""
    return records_to_msg(records, header)


def read_detections(msg: PointCloud2) -> RecordArray:
    """Detections as a numpy structured array of dtype ``core.types.DETECTION_DTYPE``; for planners.

    Raises: MessageError where the message is none of ours.
    """
    return records_from_msg(msg, DETECTION_DTYPE)


def ego_to_msg(ego: EgoMotion, header: Header) -> PointCloud2:
    """The ``ego_motion`` topic: one record."""
    record = np.zeros(1, EGO_DTYPE)
    for r in range(3):
        for c in range(3):
            record[f'm{r}{c}'] = ego.matrix[r, c]
    for index, value in enumerate(ego.covariance[UPPER]):
        record[f'c{index:02d}'] = value
    record['dt'], record['residual'] = ego.dt_s, ego.residual_px
    record['inliers'], record['tracks'] = ego.inliers, ego.tracks
    record['model'], record['status'] = int(ego.model), int(ego.status)
    record['prev_sec'], record['prev_nanosec'] = divmod(ego.prev_stamp_ns, NANOSECONDS)
    return records_to_msg(record, header)


def ego_from_msg(msg: PointCloud2) -> EgoMotion:
    """The ego-motion of a message. Raises: MessageError where it is none of ours."""
    records = records_from_msg(msg, EGO_DTYPE)
    if len(records) != 1:
        raise MessageError(f'ego_motion: expected one record, got {len(records)}')
    record = records[0]
    matrix = np.array([[record[f'm{r}{c}'] for c in range(3)] for r in range(3)])
    covariance = np.zeros((6, 6))
    covariance[UPPER] = [record[f'c{index:02d}'] for index in range(len(UPPER[0]))]
    covariance = np.triu(covariance) + np.triu(covariance, 1).T
    previous = int(record['prev_sec']) * NANOSECONDS + int(record['prev_nanosec'])
    try:
        status, model = EgoStatus(int(record['status'])), MotionModel(int(record['model']))
    except ValueError as error:
        raise MessageError(f'ego_motion: {error}') from None
    return EgoMotion(matrix, covariance, status, stamp_ns(msg.header), previous, int(record['inliers']),
                     int(record['tracks']), float(record['residual']), model)
