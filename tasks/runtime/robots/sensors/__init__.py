"""Kinds of sensors, one module each: members in `robot.yaml`, MuJoCo's sensors, numbers of observations, topic.

A module is found by being here, or in a package that a distribution names with an entry point of the group
`prefect_robomaker.sensors`. Lidar and cameras are not here: planners, proofs and videos know them too.
"""
