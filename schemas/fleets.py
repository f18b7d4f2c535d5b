"""Fleets: groups of robots that applications are deployed to."""

from .operation_shape import OperationShape

OPERATIONS: tuple[OperationShape, ...] = ()
