"""Fleets of physical robots as data: operations, documents and lifecycles of robots, fleets, and deployment jobs.

No module outside this extension (wing) imports it: registries find it by `schemas.wings`.
"""
