"""Shapes of requests and responses as tables in Markdown."""

import html
import re
from collections.abc import Iterator, Mapping
from typing import Any

from prefect_robomaker.deployments.service_model.model import service_model

from .differences import changed_bounds

Definition = Mapping[str, Any]

_MANY_VALUES = 7
"""From how many values on an enumeration has a place of its own."""
_PLAIN = {"boolean": "true or false", "timestamp": "time", "float": "number", "integer": "whole number"}
_PLAIN["long"] = _PLAIN["integer"]
_REFERENCES = {"Arn": "ARN", "ApplicationReference": "ARN or name"}
"""Words for the types whose bounds or pattern would say less."""
_LOCATIONS = {"uri": "in the path", "querystring": "in the query, once for each entry"}


class Tables:
    """Writes the shapes of the service model as tables.

    Args:
        model: A botocore service model; by default that of our own interface.
    """

    def __init__(self, model: Definition | None = None) -> None:
        self._shapes: Mapping[str, Definition] = (model or service_model())["shapes"]

    def request(self, name: str) -> str:
        """The table of a request's members, with all bounds."""
        return self._members(name, bounds=True)

    def response(self, name: str) -> str:
        """The table of a response's members; what we answer has no bounds worth telling."""
        return self._members(name, bounds=False)

    def members(self, name: str) -> list[str]:
        """Names of a structure's members."""
        return list(self._shapes[name]["members"])

    def named(self, roots: Iterator[str]) -> list[str]:
        """Names of all shapes that tables link to, in alphabetical order.

        Args:
            roots: Names of the structures whose tables are shown.
        """
        found: set[str] = set()
        waiting = list(roots)
        while waiting:
            for inner in self._inner(self._shapes[waiting.pop()]):
                if inner not in found:
                    found.add(inner)
                    waiting.append(inner)
        return sorted(name for name in found if self._has_a_place(name))

    def place(self, name: str) -> str:
        """Describes a shape in its own section: its members, its entries or its values."""
        shape = self._shapes[name]
        if shape["type"] == "structure":
            return f"{markdown(shape['documentation'])}\n\n{self._members(name, bounds=True)}"
        if shape["type"] == "map":
            most = f", at most {shape['max']} entries" if "max" in shape else ""
            key, value = (self.type_of(shape[part]["shape"], bounds=True) for part in ("key", "value"))
            return f"A map{most}. Keys: {key}. Values: {value}."
        return "One of " + ", ".join(f"`{value}`" for value in shape["enum"]) + "."

    def paths(self, name: str) -> Iterator[tuple[str, str, str, str]]:
        """All members of a structure and of the structures in it.

        Yields:
            Path from the outermost structure, name of the owner, name of the member, name of its shape.
        """
        for member, definition in self._shapes[name]["members"].items():
            yield from self._paths_of(name, member, definition["shape"], member)

    def _paths_of(self, owner: str, member: str, shape: str, path: str) -> Iterator[tuple[str, str, str, str]]:
        yield path, owner, member, shape
        definition = self._shapes[shape]
        if definition["type"] == "list":
            yield from self._paths_of(owner, member, definition["member"]["shape"], f"{path}[]")
        elif definition["type"] == "structure":
            for inner, inner_definition in definition["members"].items():
                yield from self._paths_of(shape, inner, inner_definition["shape"], f"{path}.{inner}")

    def _members(self, name: str, *, bounds: bool) -> str:
        shape = self._shapes[name]
        required = shape.get("required", ())
        lines = ["| member | type | what it is |", "| --- | --- | --- |"]
        for member, definition in sorted(shape["members"].items(), key=lambda item: bounds and item[0] not in required):
            notes = [
                *(["**required**"] if member in required and bounds else []),
                *(["deprecated"] if definition.get("deprecated") else []),
                *([_LOCATIONS[definition["location"]]] if "location" in definition else []),
            ]
            mark = f", {', '.join(notes)}" if notes else ""
            kind = self._bounded(name, member, definition["shape"]) if bounds else None
            kind = kind or self.type_of(definition["shape"], bounds=bounds)
            lines.append(f"| `{member}`{mark} | {_cell(kind)} | {_cell(markdown(definition['documentation']))} |")
        return "\n".join(lines)

    @staticmethod
    def _bounded(owner: str, member: str, shape: str) -> str | None:
        """The type of a number whose bounds depend on the request."""
        if shape != "MaxResults":
            return None
        bounds = changed_bounds()
        low, high = bounds.get(f"{owner}.{member}", bounds[shape])
        return f"whole number, {low} to {high}"

    def type_of(self, name: str, *, bounds: bool) -> str:
        """A type in words, with a link where it has a place of its own."""
        shape = self._shapes[name]
        kind = shape["type"]
        if self._has_a_place(name):
            return f"[{name}](#{name.lower()})"
        if "enum" in shape:
            return " or ".join(f"`{value}`" for value in shape["enum"])
        if name in _REFERENCES:
            return _REFERENCES[name]
        if kind == "list":
            entries = self.type_of(shape["member"]["shape"], bounds=bounds)
            return f"list of {entries}" + (_range(shape, "entries") if bounds else "")
        if kind == "string":
            return "text" + (_range(shape, "characters") + _pattern(shape) if bounds else "")
        return _PLAIN[kind] + (_range(shape, "") if bounds else "")

    def _has_a_place(self, name: str) -> bool:
        shape = self._shapes[name]
        return shape["type"] in ("structure", "map") or len(shape.get("enum", ())) >= _MANY_VALUES

    @staticmethod
    def _inner(shape: Definition) -> list[str]:
        """The shapes that a shape is made of."""
        members = [each["shape"] for each in shape.get("members", {}).values()]
        return members + [shape[part]["shape"] for part in ("member", "key", "value") if part in shape]


def markdown(documentation: str) -> str:
    """Documentation of a service model as Markdown."""
    text = re.sub(r"<code>(.*?)</code>", r"`\1`", documentation)
    return html.unescape(" ".join(re.findall(r"<p>(.*?)</p>", text, re.DOTALL)))


def _range(shape: Definition, unit: str) -> str:
    low, high = shape.get("min"), shape.get("max")
    unit = f" {unit}" if unit else ""
    if low is None and high is None:
        return ""
    if high is None:
        return f", at least {low}{unit}"
    if low == high:
        return ", exactly one" if low == 1 else f", exactly {low}{unit}"
    return f", at most {high}{unit}" if not low and unit else f", {low} to {high}{unit}"


def _pattern(shape: Definition) -> str:
    return f", `{shape['pattern']}`" if "pattern" in shape else ""


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
