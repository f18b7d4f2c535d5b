"""The processes that run one simulation job.

May import: nothing of this package.
"""
