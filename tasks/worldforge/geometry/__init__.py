"""Geometry that all of WorldForge uses: boxes, poses, primitive parts, the occupancy grid."""
