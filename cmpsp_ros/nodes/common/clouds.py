"""Moving obstacles as a point cloud, as `messages.tracks.tracks_of` reads it."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

from sensor_msgs.msg import PointCloud2, PointField

from cmpsp_ros.guidance.messages import Track

if TYPE_CHECKING:
    from collections.abc import Sequence

_NS: Final = 1_000_000_000


def cloud_of(tracks: Sequence[Track], stamp_ns: int, frame_id: str) -> PointCloud2:
    """The message that describes obstacles; numbers read back exactly."""
    signed = any(each.id < 0 for each in tracks)
    point = struct.Struct(f'<{len(Track.FIELDS)}d{"i" if signed else "I"}')
    message = PointCloud2(height=1, width=len(tracks), is_dense=True, is_bigendian=False)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, _NS)
    message.header.frame_id = frame_id
    message.fields = [
        PointField(name=name, offset=8 * place, datatype=PointField.FLOAT64, count=1)
        for place, name in enumerate(Track.FIELDS)
    ]
    kind = PointField.INT32 if signed else PointField.UINT32
    message.fields.append(
        PointField(name='id', offset=8 * len(Track.FIELDS), datatype=kind, count=1)
    )
    message.point_step = point.size
    message.row_step = point.size * len(tracks)
    message.data = b''.join(
        point.pack(each.x, each.y, each.vx, each.vy, each.radius, each.id) for each in tracks
    )
    return message
