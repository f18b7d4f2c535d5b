"""Time line of a job's page: what its run recorded, by simulated time, and the path of a job that goes on."""
