"""Robots that can be put into a world, and how they are driven."""
