"""Robots: machines that are registered with fleets."""

from .operation_shape import OperationShape

OPERATIONS: tuple[OperationShape, ...] = ()
