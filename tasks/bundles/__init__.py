"""Bundles of applications: archives, bundles of colcon, launch files; also for agents of robots, on Python 3.9."""
