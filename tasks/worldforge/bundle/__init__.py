"""World bundles (a world's folder of files).

Writing, reading and checking them, and the child processes that build and draw worlds.
"""
