"""Decoration that makes rooms look lived in, for the eye only: open windows, ceilings, lamps, skirting, cloth.

Nothing here collides, so that a decorated world steps like a plain one.
"""
