"""Writes a world as an MJCF model, and as a description for other programs."""
