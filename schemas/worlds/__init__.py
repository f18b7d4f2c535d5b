"""Worlds as data: `world.json`, how worlds are lit, what was proven of them, their description, polygons."""
