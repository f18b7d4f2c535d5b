"""Interiors of worlds: chooses and places furniture and small loose objects."""
