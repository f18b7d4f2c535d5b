"""Bundles (archives of robot and simulation applications): unpacking, colcon bundles, launch files.

Robot agents use this code, too, so it runs on Python 3.9.
"""
