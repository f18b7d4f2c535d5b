"""Owners of jobs: orders for oneself, the environment that they need, and how a job's owner stands."""
