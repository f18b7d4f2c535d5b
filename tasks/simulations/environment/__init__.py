"""Environment of a run's programs: folders, environment variables, CPU and memory limits, shared memory."""
