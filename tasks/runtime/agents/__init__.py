"""Robot applications that run in a process of their own: agent protocol, its client, and recorded actions."""
