"""Shapes that are only drawn: decoration, procedural meshes, detailed furniture, small objects."""
