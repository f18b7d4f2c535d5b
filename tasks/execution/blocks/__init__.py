"""Blocks of Prefect that jobs need while they run: credentials of their roles."""
