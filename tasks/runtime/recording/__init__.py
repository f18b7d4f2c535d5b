"""Recordings: ROS 2 messages in MCAP files and rosbag2 folders.

May import: nothing of this package.
"""

__all__ = [
    "camera_frames",
    "display_messages",
    "foxglove",
    "links",
    "messages",
    "recorder",
    "recording",
    "scan_series",
    "state_series",
]
