"""Exports of worlds to other formats: ROS packages, SDF (Gazebo), GLB, USD."""
