"""Storing a run's outputs: output locations, upload configurations, names, rolling uploads, publication."""
