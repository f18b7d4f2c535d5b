"""Guarantees of every world: measurements, limits, and the words for both."""
