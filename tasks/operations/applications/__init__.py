"""Shared parts of robot applications and simulation applications: their handlers, their records, their versions."""
