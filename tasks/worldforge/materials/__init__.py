"""Materials of floors and walls, and their textures."""
