"""Facts of the members of JSON Schemas, as pydantic makes them of models."""

import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema

from .facts import Fact

Schema = Mapping[str, Any]
Way = Literal["taken", "given"]

_LIMITS: Mapping[str, str] = {
    "exclusiveMinimum": "above",
    "exclusiveMaximum": "below",
    "minimum": "least",
    "maximum": "most",
    **{f"min{what}": "least" for what in ("Length", "Items", "Properties")},
    **{f"max{what}": "most" for what in ("Length", "Items", "Properties")},
}


def facts_of_models(models: Iterable[type[BaseModel]], way: Way) -> dict[str, Fact]:
    """Returns the facts of all members of some models, and of those that they have inside."""
    _, document = models_json_schema(
        [(model, "validation") for model in dict.fromkeys(models)], ref_template="#/$defs/{model}"
    )
    return facts_of_definitions(document.get("$defs", {}), way)


def facts_of_definitions(definitions: Mapping[str, Schema], way: Way) -> dict[str, Fact]:
    """Returns the facts of the members of shapes, as `Shape.member`; `[]` is an entry of a list, `{}` of a map."""
    members = _Members(definitions, way)
    for name, schema in definitions.items():
        if "properties" in schema:
            members.add_shape(name, schema)
    return members.facts


class _Members:
    def __init__(self, definitions: Mapping[str, Schema], way: Way) -> None:
        self._definitions = definitions
        self._way: Way = way
        self.facts: dict[str, Fact] = {}

    def add_shape(self, place: str, schema: Schema) -> None:
        for member, inner in schema["properties"].items():
            self._add(f"{place}.{member}", inner, required=member in schema.get("required", ()))

    def _add(self, place: str, schema: Schema, *, required: bool = False) -> None:
        """Adds the fact of one member, and those of what is in it."""
        forms: dict[str, list[Schema]] = defaultdict(list)
        for form in self._forms(schema, ()):
            forms[_type_of(form)].append(form)
            self._add_inner(place, form)
        types = frozenset(word for kind, each in forms.items() for word in _types(kind, each))
        limits = _limits([form for each in forms.values() for form in each]) if self._way == "taken" else {}
        default = schema.get("default") if self._way == "taken" else None
        shown = None if default is None else json.dumps(default, sort_keys=True)
        self.facts[place] = Fact(required=required, default=shown, **{self._way: types}, **limits)

    def _add_inner(self, place: str, form: Schema) -> None:
        if _is_for_each(form):
            return
        if "items" in form:
            self._add(f"{place}[]", form["items"])
        keys = [*form.get("patternProperties", {}), *filter(None, [form.get("propertyNames", {}).get("pattern")])]
        if keys and self._way == "taken":
            self.facts[f"{place}{{key}}"] = Fact(taken=frozenset({"string"}), pattern=" or ".join(sorted(keys)))
        values = form.get("additionalProperties")
        for inner in [*form.get("patternProperties", {}).values(), *([values] if isinstance(values, dict) else [])]:
            self._add(f"{place}{{}}", inner)
        if "properties" in form:
            self.add_shape(place, form)

    def _forms(self, schema: Schema, within: tuple[str, ...]) -> Iterator[Schema]:
        """Yields the forms that a value may have, where names of shapes stay and other names are looked up."""
        reference = schema.get("$ref")
        if reference is not None:
            name = reference.rpartition("/")[-1]
            found = self._definitions.get(name, {})
            if "properties" in found or name in within or name == "Reference":
                yield {"shape": name}
            else:
                yield from self._forms(found, (*within, name))
            return
        for word in ("anyOf", "oneOf", "allOf"):
            if word in schema:
                for each in schema[word]:
                    yield from self._forms(each, within)
                return
        if isinstance(schema.get("type"), list):
            yield from ({**schema, "type": each} for each in schema["type"])
        else:
            yield schema


def _is_for_each(form: Schema) -> bool:
    return "forEach" in form.get("properties", {})


def _type_of(form: Schema) -> str:
    if "shape" in form:
        return form["shape"]
    if _is_for_each(form):
        return "forEach"
    values = form.get("enum", [form["const"]] if "const" in form else [])
    kind = form.get("type") or (_json_type(values[0]) if values else "anything")
    if kind == "object" and "properties" not in form:
        return "map"
    return f"{kind} ({form['format']})" if "format" in form else str(kind)


def _json_type(value: Any) -> str:
    return {bool: "boolean", str: "string", int: "integer", float: "number"}.get(type(value), "anything")


def _types(kind: str, forms: list[Schema]) -> Iterator[str]:
    """Yields the type, or the single values where only some values of it are possible."""
    values = [form.get("enum", [form["const"]] if "const" in form else None) for form in forms]
    if any(each is None for each in values):
        yield kind
    else:
        yield from (json.dumps(value) for each in values if each for value in each)


def _limits(forms: list[Schema]) -> dict[str, Any]:
    """Returns the widest limits of some forms; those of one only where the others have none of their kind."""
    found: dict[str, list[Any]] = defaultdict(list)
    for form in forms:
        for keyword, name in _LIMITS.items():
            if keyword in form:
                found[name].append(form[keyword])
    widest: dict[str, Any] = {
        name: (min if name in ("above", "least") else max)(values) for name, values in found.items()
    }
    texts = [form for form in forms if form.get("type") == "string" and "enum" not in form and "const" not in form]
    patterns = {form["pattern"] for form in texts if "pattern" in form}
    if patterns and all("pattern" in form for form in texts):
        widest["pattern"] = " or ".join(sorted(patterns))
    return widest
