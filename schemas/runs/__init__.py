"""Runs as data: the plan, programs, variables, requirements, results, provenance, manifest and `robot.yaml`."""
