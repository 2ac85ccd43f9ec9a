# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Reads a camera from the YAML of ROS, OpenCV, Kalibr and camodocal (VINS).

ROS: camera_calibration and camera_info_manager, and a CameraInfo message printed by ``ros2 topic
echo``. OpenCV: cv::FileStorage with the usual keys.

This module stands alone, because calibration.py has the keys that this package adds to ROS's file.
"""

from __future__ import annotations

from dataclasses import dataclass
import re
from typing import Any

from p4pfr_ros.core.cameras.camera_info import CameraInfoModel
from p4pfr_ros.files.k_and_d import (
    assumption,
    camera_from_k_and_d,
    EQUIDISTANT,
    Names,
    NO_MODEL,
    PLUMB_BOB,
)
from p4pfr_ros.files.yaml_fields import Fields

# Keys, beginning with the one that errors name. Capitals, _ and - in a file make no difference.
_WIDTH = 'image_width', 'width', 'img_width'
_HEIGHT = 'image_height', 'height', 'img_height'
_SIZE = 'image_size', 'resolution', 'camera_resolution', 'img_size', 'frame_size'
_K = 'camera_matrix', 'k', 'intrinsic_matrix', 'mtx'
_D = (
    'distortion_coefficients',
    'd',
    'dist_coeffs',
    'dist_coeff',
    'distortion_coeffs',
    'distortion',
    'dist',
)
_MODEL, _KIND = 'distortion_model', 'camera_model'
_FISHEYE = 'fisheye_model', 'is_fisheye', 'use_fisheye'
_NAME, _OMNIDIRECTIONAL = 'camera_name', 'xi'
_LONGEST_KEY = 30


@dataclass(frozen=True, slots=True)
class ReadCamera:
    """
    A camera as another program wrote it.

    name
        What the file calls it; unknown without a name.
    model
        Its intrinsics and its image size.
    assumed
        What the file leaves open, and was assumed; usually empty.
    """

    name: str
    model: CameraInfoModel
    assumed: str = ''


def camera_from(fields: Fields, camera_name: str = '') -> ReadCamera:
    """
    Read the camera of a file; ``camera_name`` selects one of several.

    Raises
    ------
    ValueError
        ``KEY: expected ..., got ...: way out``.

    """
    cameras = [key for key in fields.values if re.fullmatch(r'cam(era)?_?\d+', str(key))]
    if cameras:
        name = _selected(fields, cameras, camera_name)
        return _kalibr_camera(fields.section(name), name)
    if 'intrinsics' in fields and 'resolution' in fields:
        return _kalibr_camera(fields, _name_from(fields))
    if 'projection_parameters' in fields:
        return _camodocal_camera(fields)
    return _matrix_camera(fields)


def _matrix_camera(fields: Fields) -> ReadCamera:
    """Read the files of ROS and OpenCV: K and D as matrices."""
    k_key, d_key = _key(fields, _K), _key(fields, _D)
    if k_key not in fields:
        hint = ': save K under this key, or as Kalibr does'
        raise fields.error(k_key, 'a 3x3 matrix', hint)
    k, k_path = _matrix(fields, k_key, 3, 3)
    for key, columns in (('rectification_matrix', 3), ('projection_matrix', 4)):
        if key in fields:
            _matrix(fields, key, 3, columns)  # only checked: a damaged file is not believed
    model, model_path = _model_name(fields)
    if model and model != NO_MODEL and d_key not in fields:
        raise fields.error(d_key, 'the coefficients', ': write data: [] if there are none')
    d, d_path = _coefficients(fields, d_key) if d_key in fields else ((), d_key)
    names = Names(k=k_path, d=d_path, model=model_path)
    assumed = assumption(d, model)
    if d_key not in fields and not model:
        assumed = f'no {d_key}: taken as a pinhole camera without distortion'
    size = _image_size(fields)
    return ReadCamera(_name_from(fields), camera_from_k_and_d(k, d, model, size, names), assumed)


def _model_name(fields: Fields) -> tuple[str, str]:
    """Return the name of the distortion model, and its key; the name is empty if there is none."""
    model_key, kind_key = _key(fields, (_MODEL,)), _key(fields, (_KIND, 'camera_type'))
    fisheye_key = _key(fields, _FISHEYE)
    if _OMNIDIRECTIONAL in fields:
        hint = ': calibrate again as a pinhole or fisheye camera'
        raise fields.error(_OMNIDIRECTIONAL, 'no omnidirectional camera', hint)
    given = _text(fields, model_key)
    kind = _text(fields, kind_key).lower()
    if fisheye_key in fields and not kind:
        kind = 'fisheye' if fields.values[fisheye_key] in (1, '1', 'true') else 'pinhole'
        kind_key = fisheye_key
    if not kind:
        return given, model_key
    if kind not in ('pinhole', 'fisheye', EQUIDISTANT, PLUMB_BOB):
        hint = ': correct or remove it, or calibrate again as one of them'
        raise fields.error(kind_key, 'pinhole or fisheye', hint)
    if kind == 'fisheye' and given.lower() in (PLUMB_BOB, 'rational_polynomial'):
        raise fields.error(
            model_key, f'{EQUIDISTANT}, as {kind_key} is fisheye', ': correct one of them'
        )
    return (given, model_key) if given else (kind, kind_key)


def _selected(fields: Fields, cameras: list[Any], camera_name: str) -> str:
    """Return the key of a camera of Kalibr's chain: the only one, or by its key or topic."""
    for key in cameras:
        topic = str(fields.section(key).values.get('rostopic', '')).strip('/')
        if len(cameras) == 1 or (camera_name and camera_name in (key, *topic.split('/'))):
            return str(key)
    listed = ', '.join(cameras)
    raise ValueError(
        f'{cameras[0]}: expected one camera, got {listed}: set camera_name (--camera-name) to one'
    )


def _kalibr_camera(fields: Fields, name: str) -> ReadCamera:
    """Read a camera of Kalibr's chain (EuRoC's and OpenVINS's are the same)."""
    kind = _text(fields, _KIND).lower() or 'pinhole'
    if kind not in ('pinhole', 'fisheye', EQUIDISTANT):
        raise fields.error(
            _KIND, 'pinhole', ": calibrate again with Kalibr's pinhole-radtan or pinhole-equi"
        )
    fx, fy, cx, cy = fields.numbers('intrinsics', 4)
    d_key = _key(fields, ('distortion_coeffs', *_D))
    d = fields.numbers(d_key) if d_key in fields else ()
    width, height = _size_from(fields, 'resolution')
    names = Names(
        k=fields.path_of('intrinsics'), d=fields.path_of(d_key), model=fields.path_of(_MODEL)
    )
    model = _text(fields, _MODEL) or ('' if kind == 'pinhole' else kind)
    k = (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    camera = camera_from_k_and_d(k, d, model, (width, height), names)
    return ReadCamera(name, camera, assumption(d, model))


def _camodocal_camera(fields: Fields) -> ReadCamera:
    """Read the files of camodocal, which VINS uses: PINHOLE, and KANNALA_BRANDT (a fisheye)."""
    kind = fields.choice('model_type', ('PINHOLE', 'KANNALA_BRANDT'))
    projection = fields.section('projection_parameters')
    if kind == 'PINHOLE':
        of_k, of_d, model = ('fx', 'fy', 'cx', 'cy'), ('k1', 'k2', 'p1', 'p2'), PLUMB_BOB
        distortion = fields.section('distortion_parameters')
    else:
        # theta + k2 theta^3 + k3 theta^5 + ...: named after the order of the term.
        of_k, of_d, model = ('mu', 'mv', 'u0', 'v0'), ('k2', 'k3', 'k4', 'k5'), EQUIDISTANT
        distortion = projection
    fx, fy, cx, cy = (projection.number(key) for key in of_k)
    d = tuple(distortion.number(key) for key in of_d)
    names = Names(k=projection.path, d=distortion.path, model='model_type')
    k = (fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0)
    camera = camera_from_k_and_d(k, d, model, _image_size(fields), names)
    return ReadCamera(_name_from(fields), camera)


def _image_size(fields: Fields) -> tuple[int, int]:
    key = _key(fields, _SIZE)
    if key in fields:
        return _size_from(fields, key)
    width, height = _key(fields, _WIDTH), _key(fields, _HEIGHT)
    for side in (width, height):
        if side not in fields:
            raise fields.error(side, 'an integer > 0', f': add {_WIDTH[0]} and {_HEIGHT[0]}')
    return fields.count(width), fields.count(height)


def _size_from(fields: Fields, key: str) -> tuple[int, int]:
    size = fields.values.get(key)
    if isinstance(size, dict):  # an array of OpenCV
        size = size.get('data')
    if not isinstance(size, list) or len(size) != 2:
        raise fields.error(key, 'width and height')
    sides = Fields({'width': size[0], 'height': size[1]}, fields.path_of(key))
    return sides.count('width'), sides.count('height')


def _name_from(fields: Fields) -> str:
    return _text(fields, _key(fields, (_NAME,))) or 'unknown'


def _text(fields: Fields, key: str) -> str:
    """Return a word, such as a name that is a number; empty if there is none."""
    value = fields.values.get(key)
    if value is None:
        return ''
    if not isinstance(value, (str, int, float)):
        raise fields.error(key, 'a word')
    return str(value)


def _key(fields: Fields, keys: tuple[str, ...]) -> str:
    """Return the key of a file that is one of the keys, however it is written, or the first."""
    given = {
        _plain(key): key
        for key in fields.values
        if isinstance(key, str) and len(key) <= _LONGEST_KEY
    }
    return next((given[_plain(key)] for key in keys if _plain(key) in given), keys[0])


def _plain(key: str) -> str:
    return key.replace('_', '').replace('-', '').lower()


def _matrix(fields: Fields, key: str, rows: int, columns: int) -> tuple[tuple[float, ...], str]:
    """Return the entries of a matrix, row by row, and their path: with or without its size."""
    if isinstance(fields.values.get(key), list):
        return _flat(fields, key, rows * columns), fields.path_of(key)
    matrix = fields.section(key)
    for name, size in (('rows', rows), ('cols', columns)):
        if matrix.values.get(name) != size:
            raise matrix.error(name, str(size))
    return matrix.numbers('data', rows * columns), matrix.path_of('data')


def _coefficients(fields: Fields, key: str) -> tuple[tuple[float, ...], str]:
    """Return the coefficients, in a row or a column, and their path."""
    given = fields.values[key]
    if given is None:
        return (), fields.path_of(key)
    if isinstance(given, list):
        return _flat(fields, key), fields.path_of(key)
    matrix = fields.section(key)
    data = () if matrix.values.get('data', ...) is None else matrix.numbers('data')
    sides = [matrix.values.get(name) for name in ('rows', 'cols')]
    # OpenCV writes an array of one dimension with sizes.
    if matrix.values.get('sizes') != [len(data)] and not (
        sides in ([1, len(data)], [len(data), 1]) or (not data and 0 in sides)
    ):
        raise matrix.error('cols', f'1x{len(data)} or {len(data)}x1, the length of data')
    return data, matrix.path_of('data')


def _flat(fields: Fields, key: str, n: int | None = None) -> tuple[float, ...]:
    """Return the numbers of a list, or of a list of lists."""
    rows = fields.values[key]
    entries = [entry for row in rows for entry in (row if isinstance(row, list) else [row])]
    flat = Fields(fields.values | {key: entries}, fields.path)
    return flat.numbers(key, n)
