"""The page about every operation, `docs/operations.md`."""

import inspect
import json
import re
from collections.abc import Iterator
from types import ModuleType

from prefect_robomaker.deployments.endpoint import protocol_errors
from prefect_robomaker.deployments.service_model.shapes import WIDEST
from prefect_robomaker.schemas.operations.registry import OPERATION_GROUPS, OPERATIONS
from prefect_robomaker.schemas.wire import errors
from prefect_robomaker.schemas.wire.errors import RobomakerError
from prefect_robomaker.schemas.wire.operation_shape import OperationShape
from prefect_robomaker.tasks.operations.registry import registry

from .behaviours import BEHAVIOURS, Behaviour, Kind, behaviours_of
from .differences import ANYTHING, DIFFERENCES, LINE_BREAKS
from .examples import EXAMPLES
from .tables import Tables

_WIDTH = 90
_INTRODUCTION = """\
# Operations

All {count} operations of the service. This page is made by `python -m tools.reference`; what is
different on the whole, and why, is in [Coming from RoboMaker](coming-from-robomaker.md).

Each operation can be called in four ways, and does the same in all of them:

| from | how |
| --- | --- |
| the command line | `robomaker call DescribeWorld --input '{{"world": "arn:…"}}'`; `describe-world` is as good |
| an SDK or the AWS CLI | `boto3.client("robomaker").describe_world(world="arn:…")`, see [Serving](serving.md) |
| Python | `call("DescribeWorld", {{"world": "arn:…"}}, service)` of `prefect_robomaker.tasks.operations.registry` |
| Prefect | `prefect_robomaker.DescribeWorld(world="arn:…")`, a flow, see [Prefect](prefect.md) |

Operations that start a job store it as `Pending` and answer. `robomaker serve`, `robomaker call … --wait`,
`robomaker perform ARN` and the flow carry it to its end; the flow `Perform…` does so for a job that is stored.

`robomaker schema OPERATION` prints the JSON Schema of a request. In the examples, put the ARNs that your calls have
answered in the places of those that are shown; `applications/cartpole.tar.gz` is the archive of
[Applications](applications.md#from-code-to-a-run).
"""
_FOR_ALL = frozenset({ANYTHING, LINE_BREAKS})
"""Reasons that many members share; the table of all differences is enough."""
_WIDEST = frozenset({f"{shape}:max" for shape in WIDEST})
"""Bounds that depend on the operation; tables of requests have them."""
_KINDS: dict[Kind, str] = {
    "differs": "Differs from the service",
    "decided": "Decided here, since it was not clear",
}


def operations_page() -> str:
    """Makes the page."""
    tables = Tables()
    parts = [_INTRODUCTION.format(count=len(OPERATIONS)), _contents(), _errors(), _everywhere()]
    for title, operations in OPERATION_GROUPS.items():
        parts.append(f"## {title}\n")
        parts += [_operation(operation, tables) for operation in operations]
    parts += [_interface_differences(), _shapes(tables)]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(parts)).rstrip() + "\n"


def command(operation: str) -> str:
    """The command that makes an operation's example."""
    return f"robomaker call {operation} --input '{_json(EXAMPLES[operation])}'"


def bullet(behaviour: Behaviour) -> str:
    """Formats a behaviour as an entry of a list."""
    known = "Known" if behaviour.kind == "decided" else "RoboMaker"
    return f"- **{behaviour.topic}.** {behaviour.here}<br>*{known}: {behaviour.known}*"


def _contents() -> str:
    lines = ["| about | operations |", "| --- | --- |"]
    for title, operations in OPERATION_GROUPS.items():
        links = " · ".join(f"[{each.name}](#{each.name.lower()})" for each in operations)
        lines.append(f"| [{title}](#{_anchor(title)}) | {links} |")
    more = "[Errors](#errors) · [All operations](#all-operations) · "
    more += "[Differences of the interface](#differences-of-the-interface) · [Shapes](#shapes)"
    return "## Contents\n\n" + "\n".join(lines) + f"\n\n{more}\n"


def _errors() -> str:
    own = _error_table(errors, errors.ServiceError)
    protocol = _error_table(protocol_errors, protocol_errors.ProtocolError)
    return (
        f"## Errors\n\n{own}\n\n"
        "Every operation lists those that it declares. `ServiceUnavailableException` may come from all of them, when "
        "the catalog or the object store does not answer.\n\n"
        f"Over HTTP, requests that no operation sees end with:\n\n{protocol}\n"
    )


def _error_table(module: ModuleType, base: type[RobomakerError]) -> str:
    """The errors of a module that derive from a class."""
    lines = ["| error | status | when |", "| --- | --- | --- |"]
    for name, error in inspect.getmembers(module, inspect.isclass):
        if issubclass(error, base) and error is not base:
            lines.append(f"| `{name}` | {getattr(error, 'status', '')} | {inspect.getdoc(error)} |")
    return "\n".join(lines)


def _everywhere() -> str:
    return "## All operations\n\n" + "\n".join(map(bullet, BEHAVIOURS["All operations"])) + "\n"


def _operation(operation: OperationShape, tables: Tables) -> str:
    entry = registry()[operation.name]
    flow = f"`prefect_robomaker.flows.operations:{entry.name}`"
    if entry.run_job is not None:
        flow += f"; `prefect_robomaker.flows.operations:{entry.perform_name}` carries a stored job to its end"
    parts = [
        f"### {operation.name}\n",
        operation.description + (" *The service had ended it earlier.*" if operation.deprecated else "") + "\n",
        f"- HTTP: `{operation.method} {operation.path}`",
        f"- Flow: {flow}",
        f"- Errors: {', '.join(f'`{error.__name__}`' for error in operation.errors)}\n",
        f"```console\n$ {command(operation.name)}\n```\n",
        f"**Request**\n\n{tables.request(operation.request.__name__)}\n",
        _response(operation, tables),
        *_differences(operation, tables),
    ]
    return "\n".join(parts)


def _response(operation: OperationShape, tables: Tables) -> str:
    name = operation.response.__name__
    if not (members := tables.members(name)):
        return "**Response**: empty.\n"
    summary = ", ".join(f"<code>{member}</code>" for member in members)
    return f"<details><summary><b>Response</b>: {summary}</summary>\n\n{tables.response(name)}\n\n</details>\n"


def _differences(operation: OperationShape, tables: Tables) -> Iterator[str]:
    """Yields the behaviours of an operation by kind, with those of its interface among the differences."""
    known = behaviours_of(operation.name)
    for kind, title in _KINDS.items():
        lines = [bullet(each) for each in known if each.kind == kind]
        if kind == "differs":
            lines += _interface_bullets(operation, tables)
        if lines:
            yield f"**{title}**\n\n" + "\n".join(lines) + "\n"


def _interface_bullets(operation: OperationShape, tables: Tables) -> list[str]:
    """The differences of a request's members and of their bounds, one line per reason."""
    reasons: dict[tuple[str, str], dict[str, None]] = {}
    for path, owner, member, shape in tables.paths(operation.request.__name__):
        for each in DIFFERENCES:
            place, _, trait = each.where.partition(":")
            if place in (f"{owner}.{member}", shape) and each.reason not in _FOR_ALL and each.where not in _WIDEST:
                paths = reasons.setdefault((each.reason, _bound(trait, each.ours)), {})
                if not path.startswith(tuple(f"{outer}{mark}" for outer in paths for mark in ".[")):
                    paths[path] = None
    return [
        f"- **{', '.join(f'`{path}`' for path in paths)}{bound}.** {reason}"
        for (reason, bound), paths in reasons.items()
    ]


def _bound(trait: str, value: object) -> str:
    return {"min": f" from {value}", "max": f" to {value}"}.get(trait, "")


def _interface_differences() -> str:
    lines = ["| where | here | published | why |", "| --- | --- | --- | --- |"]
    for each in DIFFERENCES:
        ours, published = (
            "" if value is None else f"`{value}`".replace("|", "\\|") for value in (each.ours, each.published)
        )
        lines.append(f"| `{each.where}` | {ours or 'nothing'} | {published or 'nothing'} | {each.reason} |")
    words = (
        "Members, bounds and patterns that are not those of the service's last published model. Everything else equals "
        "it, and tests compare both."
    )
    return f"## Differences of the interface\n\n{words}\n\n" + "\n".join(lines) + "\n"


def _shapes(tables: Tables) -> str:
    roots = [shape.__name__ for each in OPERATIONS.values() for shape in (each.request, each.response)]
    parts = ["## Shapes\n\nWhat members of requests and responses are made of.\n"]
    parts += [f"### {name}\n\n{tables.place(name)}\n" for name in tables.named(iter(roots))]
    return "\n".join(parts)


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-")


def _json(value: object, indent: int = 0) -> str:
    """JSON with what fits on a line on one line."""
    flat = json.dumps(value, ensure_ascii=False)
    if len(flat) + indent <= _WIDTH or not isinstance(value, dict | list) or not value:
        return flat
    inside = " " * (indent + 2)
    if isinstance(value, dict):
        entries = [f"{inside}{json.dumps(key)}: {_json(each, indent + 2)}" for key, each in value.items()]
    else:
        entries = [f"{inside}{_json(each, indent + 2)}" for each in value]
    first, last = "{}" if isinstance(value, dict) else "[]"
    return f"{first}\n" + ",\n".join(entries) + f"\n{' ' * indent}{last}"
