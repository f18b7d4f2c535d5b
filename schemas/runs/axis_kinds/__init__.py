"""Kinds of axes, one module each: a kind says what it varies, in which unit and bounds, and how it is applied.

A module is found by being here, or in a package that a distribution names with an entry point of the group
`prefect_robomaker.axes`.
"""
