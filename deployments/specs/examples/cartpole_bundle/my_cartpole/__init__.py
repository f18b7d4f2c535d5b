"""A pole balanced on a cart."""
