"""The agent of a robot: enroll, run, status."""
