"""The ROS bridge: a robot interface for robot applications that are ROS nodes."""
