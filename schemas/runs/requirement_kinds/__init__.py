"""Kinds of requirements, one module each: members in requests, the rule that judges a run, and its texts.

A module is found if it is in this package, or in a package that a distribution names with an entry point of the group
`prefect_robomaker.requirements`.
"""
