"""Caches of the data that console pages read from large resources.

May import: `schemas`, `tasks.catalog`, `deployments.console`.
"""
