"""Fleets: how deployments stand, and what happens next."""

__all__: list[str] = []
