"""Replaces references to a specification's parameters by their values, before anything is checked.

Later code sees plain values in the steps. A text that also refers to steps or variables is left unchanged: its
parameters are replaced when it is resolved.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ..runs.variables import SECRETS_VARIABLE, secret_names
from ..wire.errors import Place
from ..wire.json_values import is_list, is_object
from ..wire.request_problems import Location
from .parameters import NO_SECRETS, ParameterValue, ValueProblem
from .reference_typing import Record, ReferenceMistake
from .references import PARAMETERS, Interpreter, parse_template
from .yaml_nodes import ListNode, MappingNode, Node, ScalarNode, child

_OPENING = "${{"
_VARIABLES = "environmentVariables"
_LOGIN = re.compile(r"://[^/\s]*\$\{\{[^}]*\}\}[^/\s]*@")
"""Pattern of a reference before the `@` of a URL, where a login would be."""


def fold_parameters(
    root: MappingNode, kinds: Record, values: Mapping[str, ParameterValue]
) -> tuple[MappingNode, list[ValueProblem]]:
    """Replaces references to parameters in the inputs of all steps by the parameters' values.

    Args:
        root: The specification.
        kinds: Types of its parameters.
        values: Values of the parameters; a reference to a parameter without a value is kept.

    Returns:
        The specification with values, and what is wrong with references that could not be evaluated. What is wrong
        with the type of others is left to the check of the input.
    """
    steps = root.entries.get("steps")
    if not kinds.members or not isinstance(steps, MappingNode):
        return root, []
    fold = _Fold(kinds, values)
    entries: dict[str, Node] = {}
    for name, step in steps.entries.items():
        request = child(step, "input")
        if isinstance(step, MappingNode) and request is not None:
            step = replace(step, entries={**step.entries, "input": fold.node(request, ("steps", name, "input"))})
        entries[name] = step
    folded = replace(root, entries={**root.entries, "steps": replace(steps, entries=entries)})
    return folded, fold.problems


def is_folded(node: Node) -> bool:
    """Returns whether a scalar's value comes from a parameter, whose reference is at its place in the file."""
    return isinstance(node, ScalarNode) and _OPENING in node.source and node.value != node.source


@dataclass
class _Fold:
    """Replacement of references in one specification; its expressions share one limit of work."""

    kinds: Record
    values: Mapping[str, ParameterValue]
    problems: list[ValueProblem] = field(default_factory=list[ValueProblem])
    _interpreter: Interpreter = field(default_factory=Interpreter)

    def node(self, node: Node, location: Location) -> Node:
        """Returns a node with the references to parameters in it, and in all nodes below it, replaced by values.

        Those that cannot be replaced are added to `problems`.
        """
        if isinstance(node, MappingNode):
            self._refuse_secrets(node, location)
            entries = {key: self.node(value, (*location, key)) for key, value in node.entries.items()}
            return replace(node, entries=entries)
        if isinstance(node, ListNode):
            items = [self.node(item, (*location, index)) for index, item in enumerate(node.items)]
            return replace(node, items=tuple(items))
        return self._scalar(node, location)

    def _refuse_secrets(self, node: MappingNode, location: Location) -> None:
        """Reports parameters that are used in secret variables and in axes of trials with such names."""
        if location[-1:] not in ((_VARIABLES,), ("axes",)):
            return
        marked = node.entries.get(SECRETS_VARIABLE)
        variables = {SECRETS_VARIABLE: str(marked.value)} if isinstance(marked, ScalarNode) else {}
        for name in sorted(secret_names(variables, node.entries)):
            if _uses_parameters(node.entries[name]):
                self.problems.append(ValueProblem((*location, name), f"is a secret; {NO_SECRETS}"))

    def _scalar(self, node: ScalarNode, location: Location) -> Node:
        if not isinstance(node.value, str) or _OPENING not in node.value:
            return node
        try:
            template = parse_template(node.value)
            if _LOGIN.search(node.value) and any(PARAMETERS in each.names() for each in template.references):
                self.problems.append(ValueProblem(location, f"has a login in a URL; {NO_SECRETS}"))
            if not template.references or any(each.names() != {PARAMETERS} for each in template.references):
                return node
            template.kind({PARAMETERS: self.kinds})
        except ReferenceMistake:
            return node  # the check of the input tells it
        try:
            value = template.value({PARAMETERS: self.values}, self._interpreter)
        except ReferenceMistake as mistake:
            if not any(name in node.value for name in self.kinds.members if name not in self.values):
                self.problems.append(ValueProblem(location, str(mistake)))
            return node
        return _node_of(value, node.place, node.source)


def _uses_parameters(node: Node) -> bool:
    if isinstance(node, MappingNode):
        return any(map(_uses_parameters, node.entries.values()))
    if isinstance(node, ListNode):
        return any(map(_uses_parameters, node.items))
    if not isinstance(node.value, str) or _OPENING not in node.value:
        return False
    try:
        return any(PARAMETERS in each.names() for each in parse_template(node.value).references)
    except ReferenceMistake:
        return False  # the check of the input tells it


def _node_of(value: Any, place: Place, source: str) -> Node:
    """Converts a value to a node of the file, in which nothing is a reference."""
    if is_object(value):
        entries = {key: _node_of(each, place, source) for key, each in value.items()}
        return MappingNode(place, entries, dict.fromkeys(entries, place))
    if is_list(value):
        return ListNode(place, tuple(_node_of(each, place, source) for each in value))
    return ScalarNode(place, value.replace(_OPENING, f"${_OPENING}") if isinstance(value, str) else value, source)
