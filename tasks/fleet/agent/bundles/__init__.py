"""Bundles of applications: links to the modules in `tasks/bundles`, which this wheel shares with simulation jobs."""
