"""Geometry that all of WorldForge uses: boxes, poses, primitive parts, slices, the occupancy grid."""
