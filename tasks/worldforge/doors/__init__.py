"""Doors: where they hang, how far they are open, what they look like."""
