"""World bundles (a world's folder of files).

The modules write, read and check them; child processes build and draw worlds.
"""
