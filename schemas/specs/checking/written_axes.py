"""Axes of a step as they are written, before anything runs: their problems, and the types of their values."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ...runs.axes import AXIS_TAG
from ...wire.request_problems import Location, RequestProblem
from ...wire.tags import MAX_TAGS
from ..reference_typing import ANYTHING, NUMBER, Anything, Kind, ListOf, Scalar, common, kind_of_value
from ..references import PARAMETERS
from ..specification import INDEX, is_step_name
from ..step_axes import AXES, VALUE, axes_problems
from ..yaml_nodes import ListNode, MappingNode, Node, ScalarNode

_OPENING = "${{"
_MAX_TAG_KEY = 128
"""Maximum number of characters of a tag's key, which is an axis's name after a prefix."""
_CELLS = (("include",), ("exclude",))

KindOf = Callable[[str, Location], Kind | None]
"""Function that returns the type of a text with references at a location; `None` for a text without any."""


@dataclass
class WrittenAxes:
    """Axes of a step, whose values may be references that have no value yet: other values stand in for these."""

    construct: MappingNode
    kind_of: KindOf
    _unknown: dict[Location, Kind | None] = field(default_factory=dict[Location, Kind | None])
    """Types of references by their places: what is wrong with what stands in for them is no problem."""
    _wrong: list[RequestProblem] = field(default_factory=list[RequestProblem])

    def problems(self, scope: Mapping[str, Kind]) -> list[RequestProblem]:
        """Returns what is wrong, located inside the construct.

        Args:
            scope: Names that mean something else already.
        """
        if not isinstance(self.construct.entries.get(AXES, self.construct), MappingNode):
            words = "has to be a mapping of names with values, range or normal: robot: {values: [scout, rover]}"
            return [RequestProblem((AXES,), words)]
        _, found = axes_problems(self._written)
        assert self.kinds is not None  # which finds what is wrong with types
        told = [each for each in found if not self._is_unknown(each.location)]
        return [*self._wrong, *self._wrong_names(scope), *self._too_many_tags(), *told]

    @cached_property
    def kinds(self) -> dict[str, Kind]:
        """Types of the values of each axis, as references in `value` see them."""
        assert self._written is not None  # so that all references are known
        axes = self.construct.entries.get(AXES)
        named = axes.entries.items() if isinstance(axes, MappingNode) else ()
        return {name: self._kind(axis, name) for name, axis in named}

    @cached_property
    def _written(self) -> dict[str, Any]:
        entries = ((key, node) for key, node in self.construct.entries.items() if key != VALUE)
        return {key: self._plain(node, (key,)) for key, node in entries}

    def _plain(self, node: Node, location: Location) -> Any:
        if isinstance(node, MappingNode):
            return {key: self._plain(each, (*location, key)) for key, each in node.entries.items()}
        if isinstance(node, ListNode):
            return [self._plain(each, (*location, index)) for index, each in enumerate(node.items)]
        if not isinstance(node.value, str) or _OPENING not in node.value:
            return node.value
        self._unknown[location] = self.kind_of(node.value, location)
        # Each another text, as values have to differ; a count may be any.
        text = f"value {len(self._unknown)}"
        if location[:1] == (AXES,) and location[2:] == ("values",):
            return [text]
        return text if len(location) > 1 else 1

    def _is_unknown(self, location: Location) -> bool:
        """Whether a problem may be one of what stands in for a reference."""
        if any(location[: len(each)] == each for each in self._unknown):
            return True
        # Whether a cell has a value of such an axis is seen when the values are there.
        unsure = {each[1] for each in self._unknown if each[0] == AXES}
        return location[:1] in _CELLS and len(location) > 2 and location[2] in unsure

    def _too_many_tags(self) -> Iterator[RequestProblem]:
        """Finds more tags than a job may have: each axis is one, beside those that are written."""
        value, axes = self.construct.entries.get(VALUE), self.construct.entries.get(AXES)
        tags = value.entries.get("tags") if isinstance(value, MappingNode) else None
        if not isinstance(tags, MappingNode) or not isinstance(axes, MappingNode):
            return
        own, added = len(tags.entries), len(axes.entries)
        if own <= MAX_TAGS < own + added:
            yield RequestProblem(
                (VALUE, "tags"),
                f"{own} tags and {added} for the axes are {own + added}; a job has at most {MAX_TAGS}, so "
                f"{MAX_TAGS - added} would do",
            )

    def _wrong_names(self, scope: Mapping[str, Kind]) -> Iterator[RequestProblem]:
        for name in self.kinds:
            if not is_step_name(name):
                words = f"{name!r} is no name; letters, digits and _, with no digit in front, would be right"
                yield RequestProblem((AXES, name), words, about_key=True)
            elif len(AXIS_TAG) + len(name) > _MAX_TAG_KEY:
                words = f"is too long: it is in a tag of its jobs; {_MAX_TAG_KEY - len(AXIS_TAG)} characters would do"
                yield RequestProblem((AXES, name), words, about_key=True)
            elif name in scope or name in (INDEX, PARAMETERS):
                words = f"{name!r} already means something else; choose another name"
                yield RequestProblem((AXES, name), words, about_key=True)

    def _kind(self, axis: Node, name: str) -> Kind:
        whole = self._unknown.get((AXES, name))
        if isinstance(axis, ScalarNode) and isinstance(whole, ListOf | Scalar):
            words = f"{axis.source} is {whole}; it has to be a mapping: values: {axis.source}"
            self._wrong.append(RequestProblem((AXES, name), words))
        values = axis.entries.get("values") if isinstance(axis, MappingNode) else None
        if values is None:
            return NUMBER
        where: Location = (AXES, name, "values")
        if isinstance(values, ListNode):
            return common(*(self._kind_of_value(each, (*where, place)) for place, each in enumerate(values.items)))
        kind = self._unknown.get(where)
        if isinstance(values, ScalarNode) and kind is not None and not isinstance(kind, ListOf | Anything):
            self._wrong.append(RequestProblem(where, f"{values.source} is {kind}; it has to be a list of values"))
        return kind.item if isinstance(kind, ListOf) else ANYTHING

    def _kind_of_value(self, node: Node, where: Location) -> Kind:
        if not isinstance(node, ScalarNode):
            return ANYTHING
        return self._unknown.get(where) or kind_of_value(node.value)
