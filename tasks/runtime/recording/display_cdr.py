"""Bytes of the messages in `display_messages`.

These are rare and short, so that they are written member by member; see `cdr` for those that are not.
"""

import struct
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from . import display_messages as display
from . import messages as ros

_ENCAPSULATION = b"\x00\x01\x00\x00"
_STAMP = struct.Struct("<iI")
_NUMBERS = struct.Struct("<ii")
_PLAIN = struct.Struct("<10d4fiIB")


class _Writer:
    """Appends values, each aligned to its size."""

    def __init__(self) -> None:
        self._data = bytearray()

    def put(self, kind: str, *values: float) -> None:
        """Appends numbers of one type (a format character of `struct`)."""
        self._data += bytes(-len(self._data) % struct.calcsize(kind))
        self._data += struct.pack(f"<{len(values)}{kind}", *values)

    def put_bytes(self, raw: bytes) -> None:
        """Appends a sequence of bytes."""
        self.put("I", len(raw))
        self._data += raw

    def put_text(self, text: str) -> None:
        """Appends a string."""
        self.put_bytes(text.encode() + b"\0")

    def put_header(self, header: ros.Header) -> None:
        """Appends stamp and frame."""
        self.put("i", header.stamp.sec)
        self.put("I", header.stamp.nanosec)
        self.put_text(header.frame_id)

    def put_pose(self, pose: ros.Pose) -> None:
        """Appends position and orientation."""
        self.put("d", *pose.position, *pose.orientation)

    def put_raw(self, raw: bytes | bytearray) -> None:
        """Appends bytes as they are."""
        self._data += raw

    @property
    def size(self) -> int:
        """Bytes so far."""
        return len(self._data)

    def raw(self) -> bytes:
        """Returns all of it."""
        return bytes(self._data)

    def message(self) -> bytes:
        """Returns all of it with the encapsulation header."""
        return _ENCAPSULATION + self._data


def _pose_stamped(message: display.PoseStamped) -> bytes:
    writer = _Writer()
    writer.put_header(message.header)
    writer.put_pose(message.pose)
    return writer.message()


def _compressed_image(message: display.CompressedImage) -> bytes:
    writer = _Writer()
    writer.put_header(message.header)
    writer.put_text(message.format)
    writer.put_bytes(message.data)
    return writer.message()


def _camera_info(message: display.CameraInfo) -> bytes:
    header, height, width, fx, fy, cx, cy = message
    writer = _Writer()
    writer.put_header(header)
    writer.put("I", height, width)
    writer.put_text("plumb_bob")
    writer.put("I", 5)
    writer.put("d", 0, 0, 0, 0, 0)  # no distortion
    writer.put("d", fx, 0, cx, 0, fy, cy, 0, 0, 1)
    writer.put("d", 1, 0, 0, 0, 1, 0, 0, 0, 1)
    writer.put("d", fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0)
    writer.put("I", 0, 0)  # no binning
    writer.put("I", 0, 0, 0, 0)  # all of the picture
    writer.put("B", 0)
    return writer.message()


def _occupancy_grid(message: display.OccupancyGrid) -> bytes:
    writer = _Writer()
    writer.put_header(message.header)
    writer.put("i", message.header.stamp.sec)  # when the map was loaded
    writer.put("I", message.header.stamp.nanosec)
    writer.put("f", message.resolution)
    writer.put("I", message.width, message.height)
    writer.put_pose(message.origin)
    writer.put_bytes(message.data)
    return writer.message()


def _marker_array(message: display.MarkerArray) -> bytes:
    writer = _Writer()
    writer.put("I", len(message.markers))
    for marker in message.markers:
        if marker.points:
            _put_marker(writer, marker)
        else:
            _put_plain_marker(writer, marker)
    return writer.message()


def _put_plain_marker(writer: _Writer, marker: display.Marker) -> None:
    """Does what `_put_marker` does, ten times faster; a world has hundreds of markers with much that is the same."""
    (stamp, frame_id), ns, number, kind, (position, orientation), scale, color, lifetime, _, text, is_locked = marker
    template, stamp_at, number_at, pose_at = _marker_template(writer.size % 8, frame_id, ns, text)
    data = bytearray(template)
    _STAMP.pack_into(data, stamp_at, *stamp)
    _NUMBERS.pack_into(data, number_at, number, kind)
    _PLAIN.pack_into(data, pose_at, *position, *orientation, *scale, *color, *lifetime, is_locked)
    writer.put_raw(data)


@lru_cache(maxsize=1024)
def _marker_template(begin: int, frame_id: str, ns: str, text: str) -> tuple[bytes, int, int, int]:
    """A marker without points that begins at an offset, and where in it stamp, id, and pose begin."""
    blank = display.Marker(ros.Header(ros.Time(0, 0), frame_id), ns, 0, display.MarkerType.ARROW, text=text)
    writer = _Writer()
    writer.put_raw(bytes(begin))
    writer.put("i")
    stamp_at = writer.size
    writer.put_header(blank.header)
    writer.put_text(ns)
    writer.put("i")
    number_at = writer.size
    writer.put_raw(bytes(_NUMBERS.size + 4))
    writer.put("d")
    pose_at = writer.size
    whole = _Writer()
    whole.put_raw(bytes(begin))
    _put_marker(whole, blank)
    return whole.raw()[begin:], stamp_at - begin, number_at - begin, pose_at - begin


def _put_marker(writer: _Writer, marker: display.Marker) -> None:
    writer.put_header(marker.header)
    writer.put_text(marker.ns)
    writer.put("i", marker.id, marker.type, 0)  # 0: add or modify
    writer.put_pose(marker.pose)
    writer.put("d", *marker.scale)
    writer.put("f", *marker.color)
    writer.put("i", marker.lifetime.sec)
    writer.put("I", marker.lifetime.nanosec)
    writer.put("B", marker.frame_locked)
    writer.put("I", len(marker.points))
    for point in marker.points:
        writer.put("d", *point)
    writer.put("I", 0)  # no colours of points
    writer.put_text("")  # no texture: neither a file nor a picture
    writer.put_header(ros.Header(ros.Time(0, 0), ""))
    writer.put_text("")
    writer.put_bytes(b"")
    writer.put("I", 0)
    writer.put_text(marker.text)
    writer.put_text("")  # no mesh: neither a name nor a file
    writer.put_text("")
    writer.put_bytes(b"")
    writer.put("B", 0)


DISPLAY_ENCODERS: dict[type, Callable[[Any], bytes]] = {
    display.PoseStamped: _pose_stamped,
    display.CompressedImage: _compressed_image,
    display.CameraInfo: _camera_info,
    display.OccupancyGrid: _occupancy_grid,
    display.MarkerArray: _marker_array,
}
