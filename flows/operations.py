"""Every operation as a Prefect flow, with its request's members as parameters; and the flows that run stored jobs.

A flow is created on first access: `from prefect_robomaker.flows.operations import DescribeWorld`. Type checkers read
`operations.pyi`, which `python -m tools.reference` writes.
"""

import inspect
from typing import Any

from prefect import Flow

from ..schemas.operations.registry import OPERATIONS
from ..schemas.wire.operation_shape import READS, OperationShape
from ..tasks.operations.registry import registry
from ..tasks.service.service import Service
from .operation_flow import OperationFlow
from .operation_tasks import carry_out, job_id, order, read, record, validate
from .request_defaults import default_members, with_defaults_of


def __getattr__(name: str) -> Flow[..., Any]:
    """Creates the Prefect flow of an API operation, or of carrying out its jobs; the module keeps it (PEP 562).

    Raises AttributeError if no operation has that name.
    """
    if name in OPERATIONS:
        made = _operation_flow(OPERATIONS[name])
    elif makers := [entry.name for entry in registry().values() if entry.run_job and entry.perform_name == name]:
        made = _perform_flow(name, makers)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = made
    return made


def _operation_flow(shape: OperationShape) -> Flow[..., Any]:
    members, defaults = shape.request.model_fields, default_members(shape)

    def call(**given: Any) -> Any:
        if defaults:
            given = with_defaults_of(shape, given, Service.current())
        if shape.is_job:
            return order(shape.name, given)
        if shape.name.startswith(READS):
            return read(shape.name, given)
        return record(shape.name, validate(shape.name, given))

    parameters = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=defaults.get(name) if name in defaults or not field.is_required() else inspect.Parameter.empty,
            annotation=field.rebuild_annotation(),
        )
        for name, field in members.items()
    ]
    # Prefect's forms have their texts from the docstring.
    lines = [f"    {name}: {field.description}" for name, field in members.items()]
    text = "\n".join((shape.description, "", "Args:", *lines)) if lines else shape.description
    # The request model checks more, and says it better, than a generic validation of parameters.
    function = _named(call, shape.name, text, inspect.Signature(parameters))
    return OperationFlow(function, name=shape.name, description=shape.description, validate_parameters=False)


def _perform_flow(name: str, makers: list[str]) -> Flow[..., Any]:
    def perform(arn: str) -> Any:
        return carry_out(makers[0], arn)

    text = f"Carries the job of an ARN, made by {' or '.join(makers)}, to its end."
    return OperationFlow(_named(perform, name, text, inspect.signature(perform)), name=name, flow_run_name=job_id)


def _named(function: Any, name: str, text: str, signature: inspect.Signature) -> Any:
    """Returns a function that Prefect accepts as one defined in this module, with the given signature."""
    function.__name__ = function.__qualname__ = name
    function.__doc__, function.__signature__ = text, signature
    return function
