"""Balconies: outside the building at an outer wall, behind a glazed door, with a railing and without a ceiling."""
