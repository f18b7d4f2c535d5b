"""How the flows are reached: command line, specifications, Prefect deployments."""
