"""The points of a `sensor_msgs/PointCloud2`, whatever its layout."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from cmpsp_ros.sensing.beams import ScanError

_TYPES: Final = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}


def points_of(message: Any, floats: Sequence[str], integers: Sequence[str], name: str) -> Any:
    """Some fields of all points, row after row, as a structured array of shape ``(K,)``.

    Args:
        message: The cloud.
        floats: Names of fields that are floats of either length.
        integers: Names of fields that are integers of any.
        name: What errors call it.

    Raises:
        ScanError: It lacks a field, or does not fit its own sizes.
    """
    width, height, step = int(message.width), int(message.height), int(message.point_step)
    order = '>' if message.is_bigendian else '<'
    there = {field.name: field for field in message.fields}
    names, formats, offsets = [*floats, *integers], [], []
    for each in names:
        field, kinds = there.get(each), 'f' if each in floats else 'iu'
        form = '' if field is None else _TYPES.get(int(field.datatype), '')
        if field is None or form[:1] not in kinds or not form or int(field.count) not in (0, 1):
            wanted = 'a float32 or float64' if each in floats else 'an integer'
            found = 'none' if field is None else f'{field.count} of datatype {field.datatype}'
            raise ScanError(f'{name}: field {each!r}', found, wanted)
        formats.append(order + form)
        offsets.append(int(field.offset))
    row, data = int(message.row_step), np.frombuffer(message.data, dtype=np.uint8)
    fits = all(
        at + np.dtype(form).itemsize <= step for at, form in zip(offsets, formats, strict=True)
    )
    if not fits or row < step * width or len(data) < row * height:
        wanted = f'{height} rows of {row} with {width} points of {step}, each with its fields'
        raise ScanError(f'{name}: data', f'{len(data)} bytes', wanted)
    layout = np.dtype(
        {'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': max(step, 1)}
    )
    rows = data[: row * height].reshape(height, row)[:, : step * width]
    return np.frombuffer(rows.tobytes(), dtype=layout)
