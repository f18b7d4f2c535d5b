"""The wing of fleets: robots in the catalog, what they and the server say to each other, bundles that updaters install.

Nothing outside the wing imports it: registries find it by `schemas.wings`.
"""
