"""Runs as data: plan, results, programs, variables, requirements, trials, provenance and manifest."""
