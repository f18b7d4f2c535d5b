"""Runs as data: the plan, results, programs, variables, requirements, trials, provenance and manifest."""
