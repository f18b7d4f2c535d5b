"""Kinds of sensors, one module each: members of `robot.yaml`, MuJoCo sensors, observations and ROS topic.

A module is found if it is in this package, or in a package that a distribution names with an entry point of the group
`prefect_robomaker.sensors`. Lidar and cameras are not here, because planners, checks and videos use them, too.
"""
