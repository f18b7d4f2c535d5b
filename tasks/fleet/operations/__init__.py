"""Handlers of the operations about fleets, robots and deployment jobs."""
