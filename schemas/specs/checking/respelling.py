"""Renames misspelt members of a specification to the ones that were probably meant, and so checks their content."""

from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from typing import Any

from ...wire.request_problems import Location, closest
from ..reference_typing import ListOf, Structure, kind_of
from ..specification import FOR_EACH, FOR_EACH_KEYS
from ..step_axes import AXES, AXES_KEYS, VALUE, StepAxes
from ..yaml_nodes import ListNode, MappingNode, Node, ScalarNode
from .placeholders import KIND, chosen, inner

_OF_REQUIRED = 0.7
"""Similarity from which a key is taken for a required member that is missing, such as `stages` for `steps`."""


@dataclass
class Respelling:
    """A part of a specification with misspelt members renamed to the ones that were probably meant."""

    node: Node
    written: dict[Location, str] = field(default_factory=dict[Location, str])
    """Original names, by present location."""

    def path(self, location: Location) -> Location:
        """Converts a location in the renamed part to the location in the file."""
        return tuple(
            self.written.get(location[: length + 1], step) if isinstance(step, str) else step
            for length, step in enumerate(location)
        )


def respelt(node: Node, annotation: Any, known: Mapping[str, Any] | None = None) -> Respelling:
    """Renames members whose names are very similar to that of a missing member.

    Args:
        node: Part of the specification as written.
        annotation: Type annotation of the part.
        known: Further allowed names, with the types of their values.
    """
    respelling = Respelling(node)
    respelling.node = _respelt(node, annotation, (), respelling.written, known or {})
    return respelling


def _respelt(
    node: Node, annotation: Any, location: Location, written: dict[Location, str], known: Mapping[str, Any]
) -> Node:
    if isinstance(node, ListNode):
        within = inner(annotation, 0)
        items = (_respelt(each, within, (*location, index), written, {}) for index, each in enumerate(node.items))
        return replace(node, items=tuple(items))
    if not isinstance(node, MappingNode):
        return node
    tag = node.entries.get(KIND)
    annotation = chosen(annotation, tag.value if isinstance(tag, ScalarNode) else None)
    names = {**_names(node, annotation), **known}
    meant = _meant(node, names, _required(annotation) & names.keys())
    written.update({(*location, now): before for before, now in meant.items()})
    entries = {
        (name := meant.get(key, key)): _respelt(
            value, names.get(name, inner(annotation, name)), (*location, name), written, {}
        )
        for key, value in node.entries.items()
    }
    return replace(node, entries=entries, key_places={meant.get(key, key): at for key, at in node.key_places.items()})


def _names(node: MappingNode, annotation: Any) -> dict[str, Any]:
    """Returns the names that a mapping's keys may have, with their types; empty if any name is allowed."""
    kind = kind_of(annotation)
    if isinstance(kind, Structure):
        return {name: inner(annotation, name) for name in kind.model.model_fields}
    names: dict[str, Any] = {}
    if isinstance(kind, ListOf) and _has(node, AXES):
        names = {**{name: inner(StepAxes, name) for name in AXES_KEYS}, VALUE: inner(annotation, 0)}
    if isinstance(kind, ListOf) and _has(node, FOR_EACH):
        names |= {**dict.fromkeys(FOR_EACH_KEYS, Any), VALUE: inner(annotation, 0)}
    return names


def _has(node: MappingNode, name: str) -> bool:
    """Whether a mapping has a key, or one that is taken for it."""
    return name in node.entries or closest(name, node.entries, _OF_REQUIRED) is not None


def _required(annotation: Any) -> Set[str]:
    """Returns the names of the members that a value of a type cannot do without.

    A mapping in place of a list has to say of what it makes the list, by `forEach` or by axes.
    """
    kind = kind_of(annotation)
    if isinstance(kind, ListOf):
        return {FOR_EACH, AXES, VALUE}
    fields = kind.model.model_fields if isinstance(kind, Structure) else {}
    return {name for name, field_info in fields.items() if field_info.is_required()}


def _meant(node: MappingNode, names: Mapping[str, Any], required: Set[str]) -> dict[str, str]:
    """Returns the missing members for which keys are taken, by key; required members take precedence."""
    meant: dict[str, str] = {}
    for key in node.entries:
        absent = [name for name in names if name not in node.entries and name not in meant.values()]
        if key in names:
            continue
        missing = closest(key, [name for name in absent if name in required], _OF_REQUIRED)
        near = missing or closest(key, names)
        if near in absent:
            meant[key] = near
    return meant
