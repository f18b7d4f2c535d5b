"""Decoration that makes rooms look lived in: open windows, ceilings, lamps, skirting boards, curtains.

It is only visible and has no collision geometry, so a decorated world is simulated like a plain one.
"""
