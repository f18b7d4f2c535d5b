"""Prefect deployments: their names and content, and registering them on a server.

`deployables` says what there is to deploy and what it needs where it runs, `job_variables` what runs get from a work
pool, and job templates of pools, `registration` tells a Prefect server, with forms and schedules. May import:
`schemas`, `tasks`, `flows`.
"""
