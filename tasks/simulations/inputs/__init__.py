"""Inputs of a job: application archives, data sources, and the rooms of its world."""
