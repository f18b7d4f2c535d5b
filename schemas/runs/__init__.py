"""Runs as data: the plan, programs, variables, requirements, results, provenance and manifest."""
