"""Kinds of requirements, one module each: the shape that requests have, the rule that judges a run, and its words.

A module is found by being here, or in a package that a distribution names with an entry point of the group
`prefect_robomaker.requirements`.
"""
