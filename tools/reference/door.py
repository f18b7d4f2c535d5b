"""The list of all operations' flows: the module that users import them from, and their Prefect deployments."""

import json
from collections.abc import Iterator, Mapping, Sequence

from prefect_robomaker.deployments.deploying.deployables import Deployable, operation_deployables
from prefect_robomaker.schemas.operations.resources import RESOURCES
from prefect_robomaker.tasks.operations.registry import registry

_MODULE = '''\
"""The flows of all operations, by the modules of `flows` that they are in.

Written by `python -m tools.reference`. Importing this imports none of them.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
{imports}

FLOWS: dict[str, tuple[str, ...]] = {{
{flows}
}}

__all__ = [
{names}
]
'''
_MARK = "  # Deployments of all operations, written by `python -m tools.reference`.\n"


def flows_by_module() -> Mapping[str, Sequence[str]]:
    """Names of the flows of each module of `flows`: operations, and what carries their stored jobs to their end."""
    return {
        resource: sorted(
            {
                name
                for entry in registry().values()
                if entry.resource == resource
                for name in ([entry.name, entry.perform_name] if entry.run_job else [entry.name])
            }
        )
        for resource in RESOURCES
    }


def operation_flows_module() -> str:
    """Makes the module `prefect_robomaker.operation_flows`."""
    flows = flows_by_module()
    imports = [f"    from .flows.{module} import {name} as {name}" for module in flows for name in flows[module]]
    table = []
    for module, names in flows.items():
        table += [f'    "{module}": (', *(f'        "{name}",' for name in names), "    ),"]
    names = [f'    "{name}",' for name in sorted(name for names in flows.values() for name in names)]
    return _MODULE.format(imports="\n".join(imports), flows="\n".join(table), names="\n".join(names))


def with_deployments(text: str) -> str:
    """Makes the deployments of `prefect.yaml` anew; what stands before them stays.

    Raises:
        ValueError: the line that they begin with is missing.
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
