"""Serve, and set up this machine."""

__all__: list[str] = []
