"""Bring applications to robots in the field.

The commands of the wing: one module each, as in `deployments.cli.commands`.
"""
