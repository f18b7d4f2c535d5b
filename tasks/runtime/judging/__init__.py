"""Recordings as scenes: their messages, the topics that requirements are measured by, gaps in them."""
