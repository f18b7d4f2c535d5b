"""Deployment jobs: an application brought to the robots of a fleet."""

from .operation_shape import OperationShape

OPERATIONS: tuple[OperationShape, ...] = ()
