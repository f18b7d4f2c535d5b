"""Reader for Gazebo's SDF files: worlds with models, shapes, materials and meshes, as typed data."""
