"""Rollouts as data: the plan of a deployment to a fleet, how each robot stands, and what can happen.

A rollout is stored as one JSON document. Times are seconds since the epoch.
"""
