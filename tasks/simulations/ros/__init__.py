"""ROS launch files, ROS 2 domains, and the ROS 1 services of jobs."""
