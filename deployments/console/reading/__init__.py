"""What pages of the console read of large things, kept so that it is read once.

May import: `schemas`, `tasks.catalog`, `deployments.console`.
"""
