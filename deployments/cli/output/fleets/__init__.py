"""Fleets and deployments in words: tables, lines of what changes, the block on a terminal."""
