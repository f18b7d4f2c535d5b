"""Finding the flow of an operation by the operation's name."""

import importlib
from typing import Any

from prefect import Flow

from ..tasks.operations.registry import registry


def find_flow(operation: str) -> Flow[..., Any]:
    """The flow of an operation, whose parameters are the request's members.

    Raises:
        KeyError: there is no such operation.
    """
    return _flow(operation, registry()[operation].name)


def find_perform_flow(operation: str) -> Flow[..., Any]:
    """The flow that carries jobs of a job operation to their end; its parameter is the job's ARN.

    Raises:
        KeyError: there is no such operation.
    """
    return _flow(operation, registry()[operation].perform_name)


def _flow(operation: str, name: str) -> Flow[..., Any]:
    return getattr(importlib.import_module(f".{registry()[operation].resource}", __package__), name)
