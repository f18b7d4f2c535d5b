"""Reads misspelt members of a specification as those that were meant, so that what they hold is checked too."""

from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from typing import Any

from ...wire.request_problems import Location, closest
from ..reference_typing import ListOf, Structure, kind_of
from ..specification import FOR_EACH, FOR_EACH_KEYS
from ..yaml_nodes import ListNode, MappingNode, Node, ScalarNode
from .placeholders import KIND, chosen, inner

_OF_REQUIRED = 0.7
"""Likeness from which on a key is taken for a member that has to be there and is not, such as `stages` for `steps`."""


@dataclass
class Respelling:
    """A part of a specification with misspelt members under the names that they were meant to have."""

    node: Node
    written: dict[Location, str] = field(default_factory=dict[Location, str])
    """Names as they were written, by the locations that they have now."""

    def path(self, location: Location) -> Location:
        """Returns the location in the file of a location in the respelt part."""
        return tuple(
            self.written.get(location[: length + 1], step) if isinstance(step, str) else step
            for length, step in enumerate(location)
        )


def respelt(node: Node, annotation: Any, known: Mapping[str, Any] | None = None) -> Respelling:
    """Renames members whose names are very like that of one that is absent.

    Args:
        node: the part as written.
        annotation: its kind.
        known: names that members may have besides those of its model, with the kinds of their values.
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
    meant = _meant(node, names, _required(annotation))
    written.update({(*location, now): before for before, now in meant.items()})
    entries = {
        (name := meant.get(key, key)): _respelt(
            value, names.get(name, inner(annotation, name)), (*location, name), written, {}
        )
        for key, value in node.entries.items()
    }
    return replace(node, entries=entries, key_places={meant.get(key, key): at for key, at in node.key_places.items()})


def _names(node: MappingNode, annotation: Any) -> dict[str, Any]:
    """The names that a mapping's keys may have, with the kinds of their values; empty where any name is right."""
    kind = kind_of(annotation)
    if isinstance(kind, Structure):
        return {name: inner(annotation, name) for name in kind.model.model_fields}
    if isinstance(kind, ListOf) and any(key == FOR_EACH or closest(FOR_EACH, [key]) for key in node.entries):
        return {**dict.fromkeys(FOR_EACH_KEYS, Any), "value": inner(annotation, 0)}
    return {}


def _required(annotation: Any) -> Set[str]:
    """The members that a mapping has to have."""
    kind = kind_of(annotation)
    fields = kind.model.model_fields if isinstance(kind, Structure) else {}
    return {name for name, field_info in fields.items() if field_info.is_required()}


def _meant(node: MappingNode, names: Mapping[str, Any], required: Set[str]) -> dict[str, str]:
    """The absent members that keys are taken for, by key; members that have to be there go first."""
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
