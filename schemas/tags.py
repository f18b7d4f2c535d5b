"""Tags: words that users put on resources."""

from .operation_shape import OperationShape

OPERATIONS: tuple[OperationShape, ...] = ()
