"""The world as MJCF, and its description for other programs."""
