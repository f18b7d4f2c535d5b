"""Worlds as data: `world.json`, lighting, checks, descriptions for other programs, and polygons."""
