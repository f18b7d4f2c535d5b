"""Time line of a job's page: what its run recorded, by simulated time, small enough for a browser."""
