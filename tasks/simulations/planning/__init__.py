"""Makes run plans of jobs' requests: applications, launch configurations, resumed runs."""
