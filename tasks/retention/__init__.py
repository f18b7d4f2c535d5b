"""Deletes unneeded data (`robomaker gc`): old runs and jobs, unused worlds, files for robots, local copies."""
