"""Applications that come with this package.

May import: `.scout`.
"""
