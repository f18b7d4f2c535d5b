"""Rollouts as data: the plan of a deployment to a fleet, the state of each robot, and the possible events.

A rollout is stored as one JSON document. Times are seconds since the epoch.
"""
