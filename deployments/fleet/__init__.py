"""Access to fleets: commands, console pages, the update server for robots, and pools of deployment jobs.

No module outside this folder imports it: registries find it by `schemas.wings`.
"""
