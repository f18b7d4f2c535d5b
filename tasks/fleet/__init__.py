"""Fleets and robots in the catalog, what robots and server say to each other, and bundles that updaters install."""
