"""Pages of fleets, robots, deployments and applications, and of a specification's nights; all only show."""
