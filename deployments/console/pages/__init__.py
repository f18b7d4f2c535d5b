"""Pages of fleets, robots, deployments and applications, and of a specification's nights; all only show.

May import: `deployments.console`, and the rooms of `tasks` that read.
"""
