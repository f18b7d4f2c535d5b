"""Ways to reach the flows: command line, specifications, Prefect deployments."""
