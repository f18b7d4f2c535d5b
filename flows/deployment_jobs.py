"""Deployment jobs: an application brought to the robots of a fleet."""

from typing import Any

from .operation import flows_of


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
