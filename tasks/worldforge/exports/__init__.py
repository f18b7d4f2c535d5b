"""Exports: ROS packages, SDF, GLB, USD."""
