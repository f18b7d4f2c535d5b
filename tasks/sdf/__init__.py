"""Files in Gazebo's format: worlds with their models, shapes, materials and meshes, as typed data."""
