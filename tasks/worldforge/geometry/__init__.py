"""Geometry used by all of WorldForge: boxes, poses, primitive parts, slices, the occupancy grid."""
