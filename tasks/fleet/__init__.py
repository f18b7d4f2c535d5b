"""Fleets of robots: robots in the catalog, their protocol with the server, deployments, and installation files.

No module outside this folder imports it: registries find it by `schemas.wings`.
"""
