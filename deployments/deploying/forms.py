"""The schemas of parameters, from which Prefect makes its forms."""

import re
from collections.abc import Mapping
from typing import Any

from prefect import Flow
from prefect.utilities.callables import parameter_schema

_NOTHING = {"type": "null"}
_AT_ONCE = frozenset({"string", "integer", "number", "array"})
"""Types whose field is left empty for nothing; a switch cannot be, and an object's fields are many."""
_DEFAULT = re.compile(r"`?([\w.-]+)`? \(the default\)")


def form_schema(flow: Flow[..., Any]) -> dict[str, Any]:
    """The schema of a flow's parameters, from which a form shows choices, defaults and names as users know them.

    Of an optional type, a form makes one tab for the type and one for nothing, and opens that of nothing. So an
    optional text, number, choice or list is given as its type alone: what is left empty is not sent. The default of
    a choice, which the service fills in, is chosen already.
    """
    return _shown(parameter_schema(flow).model_dump_for_openapi())


def _shown(schema: Any) -> Any:
    """The same schema, and those in it, for a form."""
    if isinstance(schema, list):
        return [_shown(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    shown = {key: _shown(value) for key, value in schema.items()}
    if isinstance(properties := shown.get("properties"), Mapping):
        shown["properties"] = {name: {**_field(each), "title": name} for name, each in properties.items()}
    return shown


def _field(schema: dict[str, Any]) -> dict[str, Any]:
    """The schema of one field."""
    types = schema.get("anyOf", [])
    if _NOTHING in types and len(types) == 2:
        (given,) = [each for each in types if each != _NOTHING]
        if given.get("type") in _AT_ONCE:
            schema = {**{key: value for key, value in schema.items() if key not in ("anyOf", "default")}, **given}
    named = _DEFAULT.search(schema.get("description", ""))
    if named and "default" not in schema and named[1] in schema.get("enum", ()):
        schema = {**schema, "default": named[1]}
    return schema
