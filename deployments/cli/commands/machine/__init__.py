"""Serve, and set up this machine."""
