"""Views of fleets: states of fleets and deployments for the command line, and the report of a deployment."""
