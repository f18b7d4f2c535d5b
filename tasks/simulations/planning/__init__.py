"""From the request of a job to a run plan: applications, launch configurations, resumed runs."""
