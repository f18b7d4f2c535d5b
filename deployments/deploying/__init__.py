"""Deployments in Prefect: what each is called and keeps, and how a server comes to have it.

`deployables` says what there is to deploy, `needs` what a specification wants to find where it runs, `schedules` when
it runs, `job_variables` what its runs get from a work pool, `forms` what forms ask for, `registration` tells a Prefect
server, `pool_templates` makes job templates of work pools. May import: `schemas`, `tasks`, `flows`. Only `forms`,
`schedules`, `registration` and `pool_templates` import Prefect.
"""
