"""The flows of all operations: the module that users import them from, their types, and their deployments."""

import json
from collections.abc import Iterator
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from prefect_robomaker.deployments.deploying.deployables import Deployable, operation_deployables
from prefect_robomaker.flows.request_defaults import default_members
from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.tasks.operations.registry import registry

_NAMES = '''\
"""The names of the flows of all operations.

Written by `python -m tools.reference`. Importing this imports none of them.
"""

# ruff: noqa: F405 - the stub of `flows.operations` has the names

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .flows.operations import *  # noqa: F403 - the flows of all operations

__all__ = [
{names}
]
'''
_STUB = '''\
"""The flows of all operations, as type checkers see them; written by `python -m tools.reference`."""

from typing import Any, Literal

from prefect import flow

{imports}

{flows}
'''
_MARK = "  # Deployments of all operations, written by `python -m tools.reference`.\n"


def operation_flows_module() -> str:
    """Makes the module `prefect_robomaker.operation_flows`."""
    return _NAMES.format(names="\n".join(f'    "{name}",' for name in sorted([*OPERATIONS, *_performing()])))


def flows_stub() -> str:
    """Makes `flows/operations.pyi`: the flows with their parameters."""
    models: set[type[BaseModel]] = set()
    flows = [_stub(name, "arn: str") for name in _performing()]
    for name, shape in OPERATIONS.items():
        defaults = default_members(shape)
        ends = {
            member: " = ..." if member in defaults else "" if field.is_required() else " = None"
            for member, field in shape.request.model_fields.items()
        }
        members = sorted(shape.request.model_fields.items(), key=lambda item: ends[item[0]] != "")
        parameters = [f"{member}: {_type(field.annotation, models)}{ends[member]}" for member, field in members]
        flows.append(_stub(name, ", ".join(["*", *parameters])))
    package = "prefect_robomaker."
    imports = {f"from ..{each.__module__.removeprefix(package)} import {each.__name__}" for each in models}
    return _STUB.format(imports="\n".join(sorted(imports)), flows="\n".join(flows))


def _performing() -> list[str]:
    return sorted({entry.perform_name for entry in registry().values() if entry.run_job})


def _stub(name: str, parameters: str) -> str:
    return f"@flow\ndef {name}({parameters}) -> dict[str, Any]: ..."


def _type(annotation: Any, models: set[type[BaseModel]]) -> str:
    """The text of a type without bounds; adds the models that it names."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _type(arguments[0], models)
    if origin is Literal:
        return f"Literal[{', '.join(map(repr, arguments))}]"
    if origin in (Union, UnionType):
        return " | ".join(_type(each, models) for each in arguments)
    if origin is not None:
        return f"{origin.__name__}[{', '.join(_type(each, models) for each in arguments)}]"
    if annotation is NoneType:
        return "None"
    if issubclass(annotation, BaseModel):
        models.add(annotation)
    return annotation.__name__


def with_deployments(text: str) -> str:
    """Makes the deployments of `prefect.yaml` anew; what stands before them stays.

    Raises:
        ValueError: The line that they begin with is missing.
    """
    before, mark, _ = text.partition(_MARK)
    if not mark:
        raise ValueError(f"prefect.yaml has no line {_MARK.strip()!r}")
    entries = [line for each in operation_deployables() for line in _entry(each)]
    return before + mark + "\n".join(entries) + "\n"


def _entry(made: Deployable) -> Iterator[str]:
    # Texts are written as JSON, which YAML reads.
    yield f"  - name: {made.name}"
    yield f"    entrypoint: {made.entrypoint}"
    yield f"    description: {json.dumps(made.description, ensure_ascii=False)}"
    yield f"    tags: [{', '.join(made.tags)}]"
    yield "    work_pool: *work_pool"
