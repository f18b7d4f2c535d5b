"""The pages about all operations, made from the schemas, the registry and what is listed of differences.

`python -m tools.reference` writes `docs/operations.md`, the tables of
`docs/coming-from-robomaker.md`, the map of `docs/architecture.md`, and the files that list all flows:
`prefect_robomaker/operation_flows.py`, `flows/operations.pyi` and the deployments of `prefect.yaml`. A test
compares what is committed.
"""
