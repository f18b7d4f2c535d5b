"""Fleets seen: how they and their deployments stand, and the report of a deployment."""
