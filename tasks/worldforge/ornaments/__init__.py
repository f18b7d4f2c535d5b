"""Shapes that are only drawn: ornaments, procedural shapes, furniture drawn with these, small things."""
