"""Makes the plan of a run from a job's request: applications, launch configurations, resumed runs."""
