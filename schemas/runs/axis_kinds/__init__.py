"""Kinds of axes, one module each: the varied quantity, its unit and bounds, and how a value is applied.

A module is found if it is in this package, or in a package that a distribution names with an entry point of the group
`prefect_robomaker.axes`.
"""
