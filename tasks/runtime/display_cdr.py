"""Bytes of the messages in `display_messages`.

These are rare and short, so that they are written member by member; see `cdr` for those that are not.
"""

import struct
from collections.abc import Callable
from typing import Any

from . import display_messages as display
from . import messages as ros

_ENCAPSULATION = b"\x00\x01\x00\x00"


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
        _put_marker(writer, marker)
    return writer.message()


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
