"""The pages about all operations, made from the schemas, the registry and what is listed of differences.

`python -m prefect_robomaker.deployments.reference` writes `docs/operations.md` and the tables of
`docs/coming-from-robomaker.md`; a test compares what is committed.
"""
