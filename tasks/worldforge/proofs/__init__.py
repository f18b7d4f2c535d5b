"""Guarantees of every world: measurements, limits, and their wording."""
