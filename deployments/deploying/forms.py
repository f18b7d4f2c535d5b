"""The schemas of parameters, from which Prefect makes its forms."""

from typing import Any

from prefect import Flow
from prefect.utilities.callables import parameter_schema


def form_schema(flow: Flow[..., Any]) -> dict[str, Any]:
    """The schema of a flow's parameters, in which choices that are optional are shown as choices.

    Of an optional type, a form makes one tab for the type and one for nothing, and opens that of nothing. A list of
    choices without a default is optional as well: what is not chosen is not sent.
    """
    schema = parameter_schema(flow).model_dump_for_openapi()
    schema["properties"] = {name: _choices(property_) for name, property_ in schema["properties"].items()}
    return schema


def _choices(schema: dict[str, Any]) -> dict[str, Any]:
    types = schema.get("anyOf", ())
    for each in types:
        if "enum" in each and {"type": "null"} in types and len(types) == 2:
            return {**{key: value for key, value in schema.items() if key not in ("anyOf", "default")}, **each}
    return schema
