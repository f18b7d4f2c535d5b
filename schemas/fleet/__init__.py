"""The wing of fleets as data: operations, documents and lifecycles of robots, fleets and deployment jobs; rollouts.

Nothing outside the wing imports it: registries find it by `schemas.wings`.
"""
