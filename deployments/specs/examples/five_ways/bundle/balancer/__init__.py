"""A robot that keeps a pole upright, as a program of its own."""
