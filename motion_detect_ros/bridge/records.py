"""Structured arrays <-> PointCloud2: the ``ego_motion`` and ``detections`` topics."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from motion_detect_ros.bridge.images import bytes_of, stamp_ns
from motion_detect_ros.core.errors import MessageError
from motion_detect_ros.core.load_control import STEPS
from motion_detect_ros.core.types import (
    DETECTION_DTYPE,
    NANOSECONDS,
    EgoMotion,
    EgoStatus,
    MotionModel,
    RecordArray,
    RelativePose,
)

#: Row and column of the upper triangle of a 6 x 6 matrix, in row order: c00 .. c20.
UPPER = np.triu_indices(6)
#: What every ego_motion record has ever had; never changed.
EGO_FIELDS = [
    *((f'm{r}{c}', '<f8') for r in range(3) for c in range(3)),
    *((f'c{i:02d}', '<f8') for i in range(len(UPPER[0]))),
    ('dt', '<f8'), ('inliers', '<u4'), ('tracks', '<u4'), ('residual', '<f4'), ('model', 'u1'), ('status', 'u1'),
    ('prev_sec', '<u4'), ('prev_nanosec', '<u4')]
#: The camera's relative pose, NaN where unknown.
EGO_CAMERA_FIELDS = [
    *((f'r{r}{c}', '<f8') for r in range(3) for c in range(3)), ('t0', '<f8'), ('t1', '<f8'), ('t2', '<f8'),
    ('e0', '<f8'), ('e1', '<f8'), ('g0', '<f8'), ('g1', '<f8'), ('g2', '<f8')]
#: What came later; records without them are read too, as NaN or 0.
EGO_LATER_FIELDS = [*EGO_CAMERA_FIELDS, ('load_step', 'u1')]
EGO_DTYPE = np.dtype(EGO_FIELDS + EGO_LATER_FIELDS)

_DATATYPES = {
    'i1': PointField.INT8, 'u1': PointField.UINT8, 'i2': PointField.INT16, 'u2': PointField.UINT16,
    'i4': PointField.INT32, 'u4': PointField.UINT32, 'f4': PointField.FLOAT32, 'f8': PointField.FLOAT64,
}
_FORMATS = {datatype: name for name, datatype in _DATATYPES.items()}


def records_to_msg(records: RecordArray, header: Header) -> PointCloud2:
    """Any flat structured array as an unordered cloud, one record a point.

    records: (N,), little endian, fields of whole numbers of 1 to 4 bytes or floats of 4 or 8. header: copied as it is.
    Raises: KeyError for a field of another type.
    """
    dtype = records.dtype
    fields = [PointField(name=name, offset=place[1], datatype=_DATATYPES[place[0].str[1:]], count=1)
              for name, place in (dtype.fields or {}).items()]
    return PointCloud2(
        header=header, height=1, width=len(records), fields=fields, is_bigendian=False, point_step=dtype.itemsize,
        row_step=dtype.itemsize * len(records), data=bytes_of(records.view(np.uint8)), is_dense=True)


def records_from_msg(
    msg: PointCloud2, dtype: np.dtype[np.void], optional: Collection[str] = (),
) -> RecordArray:
    """The message's points as ``dtype``, found by field name; fields that ``dtype`` does not have are left out.

    optional: fields that the message may lack; they become NaN where they are floats, else 0.
    Raises: MessageError where another field is missing, lies outside its record, is of an unknown type, or the data are
    shorter than promised.
    """
    present = {field.name for field in msg.fields}
    absent = [name for name in dtype.names or () if name in optional and name not in present]
    names = tuple(name for name in dtype.names or () if name not in absent)
    layout = _layout_of(msg, names)
    rows = _rows_of(msg)
    records = np.empty((msg.height, msg.width), dtype)
    for name in absent:
        records[name] = np.nan if dtype[name].kind == 'f' else 0
    if records.size:
        source = rows.view(layout)
        for name in names:
            records[name] = source[name]
    return records.reshape(-1)


def _layout_of(msg: PointCloud2, names: tuple[str, ...]) -> np.dtype[np.void]:
    """Where ``names`` lie within one record of the message."""
    fields = {field.name: field for field in msg.fields}
    missing = [name for name in names if name not in fields]
    if missing:
        raise MessageError(f'records: expected fields {", ".join(missing)}, got {", ".join(fields)}')
    order = '>' if msg.is_bigendian else '<'
    formats = [order + _format_of(fields[name]) for name in names]
    try:
        return np.dtype({'names': list(names), 'formats': formats, 'itemsize': msg.point_step,
                         'offsets': [fields[name].offset for name in names]})
    except ValueError:
        end, last = max((fields[name].offset + np.dtype(form).itemsize, name)
                        for name, form in zip(names, formats, strict=True))
        raise MessageError(
            f'records: expected point_step of at least {end} bytes for field {last}, got {msg.point_step}') from None


def _format_of(field: PointField) -> str:
    if field.datatype not in _FORMATS:
        raise MessageError(f'records: expected field {field.name} of datatype 1 to 8, got {field.datatype}')
    return _FORMATS[field.datatype]


def _rows_of(msg: PointCloud2) -> npt.NDArray[np.uint8]:
    """(height, width * point_step) bytes, padding at the end of rows cut off."""
    row_bytes = msg.width * msg.point_step
    # Some publishers leave row_step at 0 or give it for all rows; with one row it says nothing.
    step = row_bytes if msg.height <= 1 else msg.row_step
    data, needed = np.frombuffer(msg.data, np.uint8), step * max(msg.height - 1, 0) + row_bytes * min(msg.height, 1)
    if step < row_bytes:
        raise MessageError(f'records: expected row_step of at least {row_bytes} bytes, got {step}')
    if data.size < needed:
        raise MessageError(f'records: expected {needed} bytes, got {data.size}')
    rows = np.lib.stride_tricks.as_strided(data, (msg.height, row_bytes), (step, 1), writeable=False)
    return np.ascontiguousarray(rows)


def detections_to_msg(records: RecordArray, header: Header) -> PointCloud2:
    """The ``detections`` topic. records: dtype ``DETECTION_DTYPE``."""
    return records_to_msg(records, header)


def read_detections(msg: PointCloud2) -> RecordArray:
    """Detections as a numpy structured array of dtype ``core.types.DETECTION_DTYPE``; for planners.

    Raises: MessageError where the message is none of ours.
    """
    return records_from_msg(msg, DETECTION_DTYPE)


def ego_to_msg(ego: EgoMotion, header: Header) -> PointCloud2:
    """The ``ego_motion`` topic: one record. Raises: MessageError for times before 1970, which it cannot hold."""
    if ego.prev_stamp_ns < 0:
        raise MessageError(f'ego_motion: expected a stamp of at least 0 ns, got {ego.prev_stamp_ns}')
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
    record['load_step'] = ego.load_step
    for (name, _), value in zip(EGO_CAMERA_FIELDS, _camera_values(ego.camera), strict=True):
        record[name] = value
    return records_to_msg(record, header)


def _camera_values(camera: RelativePose | None) -> npt.NDArray[np.float64]:
    """(17,) rotation by rows, translation, epipole, ground; NaN where unknown."""
    if camera is None:
        return np.full(len(EGO_CAMERA_FIELDS), np.nan)
    ground = np.full(3, np.nan) if camera.ground is None else camera.ground
    return np.concatenate([camera.rotation.ravel(), camera.direction, camera.epipole, ground])


def _camera_from(record: np.void) -> RelativePose | None:
    values = np.array([record[name] for name, _ in EGO_CAMERA_FIELDS])
    rotation, direction, epipole, ground = values[:9].reshape(3, 3), values[9:12], values[12:14], values[14:]
    if not np.isfinite(values[:12]).all():
        return None
    return RelativePose(rotation, direction, epipole, ground if np.isfinite(ground).all() else None)


def ego_from_msg(msg: PointCloud2) -> EgoMotion:
    """The ego-motion of a message. Raises: MessageError where it is none of ours."""
    records = records_from_msg(msg, EGO_DTYPE, dict(EGO_LATER_FIELDS))
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
                     int(record['tracks']), float(record['residual']), model, _camera_from(record),
                     checked_step('ego_motion', int(record['load_step'])))


def checked_step(topic: str, number: int) -> int:
    """A number of a step of ``load.adapt``. Raises: MessageError where it is none that this version knows."""
    if number >= len(STEPS):
        raise MessageError(f'{topic}: expected load_step 0 to {len(STEPS) - 1}, got {number}')
    return number
