"""Storing a run's outputs: destination, upload configurations, file names, uploads during the run, manifest."""
