"""Robots that are programs of their own: the agent protocol, its client, and recorded actions."""
