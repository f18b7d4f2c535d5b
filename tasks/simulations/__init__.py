"""Simulation jobs: planning a run, its inputs, containers, ROS and outputs; storing jobs in the catalog."""
