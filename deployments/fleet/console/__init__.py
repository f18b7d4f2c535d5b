"""The console's pages of fleets, robots and deployments."""
