"""Recordings of runs: ROS 2 messages in MCAP files and rosbag2 folders."""
