"""Rendering of a simulation: cameras, views, light, OpenGL and ray casting."""
