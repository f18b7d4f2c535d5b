"""The commands of `robomaker`."""
