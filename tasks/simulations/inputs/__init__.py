"""Inputs of a job: application bundles, data sources, the rooms of its world."""
