"""Handlers of the 57 operations, one module per resource: check, store, answer; no Prefect. Steps have one more."""
