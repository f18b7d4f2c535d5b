"""Runs of simulation jobs: planning, inputs, containers, ROS, outputs; storing a job."""
