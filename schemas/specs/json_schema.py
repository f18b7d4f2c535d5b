"""JSON Schema of specifications, for editors and for checks without this program.

`python -m prefect_robomaker.schemas.specs.json_schema` writes `pipeline.schema.json` beside this module. It checks less
than `check.py`, as it does not know the values of references.
"""

import json
from pathlib import Path
from typing import Any

from pydantic.json_schema import models_json_schema

from ..operations.registry import STEPS
from ..templates.body import WorldTemplateBody
from ..wire.job_configs import WorldConfig
from ..wire.json_values import is_object
from .checking.placeholders import inner, names_world
from .parameters import Parameter
from .specification import FOR_EACH, IF_EXISTS, Spec, Step
from .step_axes import AXES, SEEDS, VALUE, StepAxes, StepAxis

SCHEMA_FILE = Path(__file__).with_name("pipeline.schema.json")

_REF = "#/$defs/{model}"
_REFERENCE = {"$ref": "#/$defs/Reference"}
_WORLD_NAMES = {
    True: "World: its name, its id or the beginning of that, or its ARN.",
    False: "Worlds: their names, their ids or the beginnings of those, or their ARNs.",
}
"""Descriptions of members that name a world, or several (False)."""
_DEFINITIONS: dict[str, Any] = {
    "Reference": {
        "type": "string",
        "pattern": r"\$\{\{[\s\S]*\}\}",
        "description": "A reference `${{ step.member }}`: JMESPath over what earlier steps gave and `parameters`.",
    },
}


def spec_schema() -> dict[str, Any]:
    """Generates the JSON schema of specification files from the models, for editors."""
    models = [Spec, WorldTemplateBody, StepAxis, *(operation.request for operation in STEPS.values())]
    _, document = models_json_schema([(model, "validation") for model in models], ref_template=_REF)
    # These stay as they are; everything else may be written with references.
    own = (Spec.__name__, Step.__name__, Parameter.__name__)
    definitions = {
        name: schema if name in own else _with_references(schema) for name, schema in document["$defs"].items()
    }
    definitions |= _DEFINITIONS
    _allow_names_of_worlds(definitions)
    _allow_body(definitions)
    _allow_no_role(definitions)
    axis = definitions[StepAxis.__name__]["properties"]
    definitions[StepAxis.__name__]["properties"] = {name: _written_out(each) for name, each in axis.items()}
    definitions["Step"] = _step(definitions["Step"])
    spec = definitions.pop("Spec")
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "RoboMaker pipeline",
        "description": "A pipeline of operations, or a single operation; docs/specification.md has every construct.",
        "if": {"required": ["operation"], "not": {"required": ["steps"]}},
        "then": {"$ref": "#/$defs/Single"},
        "else": spec,
        "$defs": {**definitions, "Single": _single()},
    }


def _step(schema: dict[str, Any]) -> dict[str, Any]:
    """Returns the schema of a step whose `input` is its operation's request.

    `schema`, that of the model, is changed in place, too.
    """
    schema["properties"]["operation"]["enum"] = sorted(STEPS)
    rules: list[dict[str, Any]] = [
        {
            "if": {"properties": {"operation": {"const": name}}, "required": ["operation"]},
            "then": {"properties": {"input": {"$ref": f"#/$defs/{operation.request.__name__}"}}},
        }
        for name, operation in sorted(STEPS.items())
    ]
    rules += [
        {
            "if": {"properties": {"operation": {"const": name}}, "required": ["operation"]},
            "then": {"properties": {"ifExists": {"enum": list(values)}}},
        }
        for name, values in sorted(IF_EXISTS.items())
    ]
    rules.append(
        {
            "if": {"properties": {"operation": {"enum": sorted(IF_EXISTS)}}},
            "else": {"properties": {"ifExists": {"const": "fail"}}},
        }
    )
    return {**schema, "allOf": rules}


def _single() -> dict[str, Any]:
    """Returns the schema of a file with one operation: with `input`, or with the request's members themselves."""
    return {
        "type": "object",
        "required": ["operation"],
        "properties": {"operation": {"enum": sorted(STEPS), "description": "The operation to call."}},
    }


def _with_references(schema: dict[str, Any]) -> dict[str, Any]:
    """Returns a schema in which a structure's members may be references, and lists may be `forEach`."""
    properties = {name: _flexible(each) for name, each in schema.get("properties", {}).items()}
    if requests := properties.get("createSimulationJobRequests"):
        [items] = [each["items"] for each in requests["anyOf"] if each.get("type") == "array"]
        properties["createSimulationJobRequests"] = {**requests, "anyOf": [*requests["anyOf"], _axes(items)]}
    return {**schema, "properties": properties} if properties else schema


def _flexible(schema: dict[str, Any]) -> dict[str, Any]:
    """Returns the schema of a value or a reference to one."""
    described = {key: schema[key] for key in ("description", "title", "deprecated") if key in schema}
    kept = {key: value for key, value in schema.items() if key not in (*described, "anyOf", "default")}
    alternatives = [each for each in schema.get("anyOf", [kept]) if each != {"type": "null"}]
    return {**described, "anyOf": [*(form for each in alternatives for form in _forms(each)), _REFERENCE]}


def _forms(schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Returns the schemas of a list or mapping with references; other schemas are unchanged."""
    if schema.get("type") == "array":
        items = _flexible(schema.get("items", {}))
        return [{**schema, "items": items}, _for_each(items)]
    if is_object(values := schema.get("additionalProperties")):
        return [{**schema, "additionalProperties": _flexible(values)}]
    if patterns := schema.get("patternProperties"):
        return [{**schema, "patternProperties": {key: _flexible(each) for key, each in patterns.items()}}]
    return [schema]


def _for_each(item: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "description": "A list with one entry for each entry of another.",
        "required": [FOR_EACH, "value"],
        "additionalProperties": False,
        "properties": {
            FOR_EACH: {
                "description": "The list to go through: a reference, or the entries themselves.",
                "anyOf": [_REFERENCE, {"type": "array"}],
            },
            "as": {
                "description": "Name of the variable that holds the entry in `value` (default: item); `index` holds "
                "its position, from 0.",
                "type": "string",
                "pattern": "^[a-zA-Z_][a-zA-Z0-9_]*$",
            },
            "value": {**item, "description": "The new entry; may refer to the variable."},
        },
    }


def _axes(item: dict[str, Any]) -> dict[str, Any]:
    """Returns the JSON schema of axes, which may stand in place of a list of job requests."""
    members = StepAxes.model_json_schema(ref_template=_REF)["properties"]
    flexible = {name: _written_out(_flexible(each)) for name, each in members.items()}
    flexible[AXES]["anyOf"] = [each for each in flexible[AXES]["anyOf"] if each != _REFERENCE]
    return {
        "type": "object",
        "description": "One job for each combination of the values of axes, and for each seed.",
        "required": [VALUE],
        "anyOf": [{"required": [AXES]}, {"required": [SEEDS]}],
        "additionalProperties": False,
        "properties": {**flexible, VALUE: {**item, "description": "The request of each job; may refer to the axes."}},
    }


def _written_out(schema: dict[str, Any]) -> dict[str, Any]:
    """Returns the JSON schema of a member of axes without the form `forEach`."""
    forms = [each for each in schema["anyOf"] if FOR_EACH not in each.get("properties", {})]
    return {**schema, "anyOf": forms}


def _allow_names_of_worlds(definitions: dict[str, Any]) -> None:
    """Changes definitions of a JSON schema: what has to be the ARN of a world on the wire may be its name."""
    for model in (WorldConfig, *(operation.request for operation in STEPS.values())):
        for name, field in model.model_fields.items():
            annotation = field.rebuild_annotation()
            if names_world(annotation) or names_world(inner(annotation, 0)):
                member = definitions[model.__name__]["properties"][name]
                _remove_patterns(member)
                member["description"] = _WORLD_NAMES[names_world(annotation)]


def _remove_patterns(schema: dict[str, Any]) -> None:
    """Removes the patterns of texts from a member's JSON schema, except from that of references."""
    schema.pop("pattern", None)
    for each in (*schema.get("anyOf", ()), *filter(None, [schema.get("items")])):
        _remove_patterns(each)


def _allow_body(definitions: dict[str, Any]) -> None:
    """Changes definitions of a JSON schema: a template body may be a mapping, whose content is described.

    `definitions` is changed in place.
    """
    for operation in STEPS.values():
        properties = definitions[operation.request.__name__].get("properties", {})
        if "templateBody" in properties:
            alternatives = [each for each in properties["templateBody"]["anyOf"] if each.get("type") != "object"]
            properties["templateBody"]["anyOf"] = [{"$ref": "#/$defs/WorldTemplateBody"}, *alternatives]


def _allow_no_role(definitions: dict[str, Any]) -> None:
    """Changes definitions of a JSON schema: steps that name no role have that of calls in Python.

    `definitions` is changed in place.
    """
    for operation in STEPS.values():
        schema = definitions[operation.request.__name__]
        if "iamRole" in schema.get("required", ()):
            schema["required"] = [name for name in schema["required"] if name != "iamRole"]


def schema_text() -> str:
    """Returns the JSON schema of specification files as text, exactly as the committed file has it."""
    return json.dumps(spec_schema(), indent=1, ensure_ascii=False, sort_keys=True) + "\n"


if __name__ == "__main__":
    SCHEMA_FILE.write_text(schema_text())
