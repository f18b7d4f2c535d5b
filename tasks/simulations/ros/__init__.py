"""ROS launch files, ROS 2 domains, and the ROS 1 services of jobs.

May import: `schemas`, `tasks.service`.
"""

__all__ = ["domains", "job_services", "launching"]
