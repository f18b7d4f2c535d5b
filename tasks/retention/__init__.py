"""Removing what is unneeded: old runs, their outputs and jobs, worlds that nothing names, files for robots, copies."""
