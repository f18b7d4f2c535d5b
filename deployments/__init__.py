"""Ways to use the flows: command line, HTTP endpoint, web console, specifications, Prefect deployments."""
