"""ROS bridge: robot interface for robot applications that are ROS nodes."""
