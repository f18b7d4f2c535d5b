"""Fleets: groups of robots that applications are deployed to."""

from typing import Any

from .operation import flows_of


def __getattr__(name: str) -> Any:
    return flows_of(__name__)(name)
