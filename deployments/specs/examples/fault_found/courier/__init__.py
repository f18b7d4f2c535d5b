"""A small robot that brings things to the next room, and the two rooms that it is tried in."""
