"""Finds the packages, which lie in four folders of the top level; `pyproject.toml` says everything else."""

from setuptools import find_packages, setup

FOLDERS = ("schemas", "tasks", "flows", "deployments")

setup(
    packages=[
        *("prefect_robomaker", *(f"prefect_robomaker.{folder}" for folder in FOLDERS)),
        *(f"prefect_robomaker.{folder}.{name}" for folder in FOLDERS for name in find_packages(folder)),
    ]
)
