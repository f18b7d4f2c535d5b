"""The wing of fleets as it is reached: commands, console pages, the door of robots beside the endpoint, job workers.

Nothing outside the wing imports it: registries find it by `schemas.wings`.
"""
