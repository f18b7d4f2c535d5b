"""ROS launch files and ROS 2 domains.

May import: nothing of this package.
"""

__all__ = ["domains", "launching"]
