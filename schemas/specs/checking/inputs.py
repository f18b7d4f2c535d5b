"""Checks a step's input before anything runs: references, their types, the request's shape, template bodies.

References have no values yet. Fitting placeholders replace them during validation, and errors about a placeholder
itself are ignored.
"""

import json
import re
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

from ...operations.registry import STEPS, check_request
from ...roles import LOCAL_ROLE
from ...templates.body import WorldTemplateBody
from ...templates.parsing import MAX_BODY_CHARACTERS, body_problems, unwrapped
from ...wire.base import Shape
from ...wire.errors import InvalidParameterException, Place, Problem
from ...wire.json_values import is_object, load_strict
from ...wire.request_problems import Location, RequestProblem, nearest, path_text
from ..batch_splitting import parts_of
from ..parameter_folding import is_folded
from ..reference_typing import (
    ANYTHING,
    TEXT,
    WHOLE_NUMBER,
    Anything,
    Kind,
    ListOf,
    Scalar,
    fits,
    kind_of,
)
from ..references import PARAMETERS, ReferenceMistake, parse_template
from ..specification import (
    FOR_EACH,
    FOR_EACH_KEYS,
    INDEX,
    NamedWorld,
    as_written,
    axes_of,
    for_each_of,
    is_step_name,
    place_of,
    variable_of,
)
from ..step_axes import AXES, VALUE, clashing_axes, clashing_words, is_axes_location
from ..yaml_nodes import ListNode, MappingNode, Node, ScalarNode, child, key_place, node_at, plain, value_place
from .placeholders import KIND, Placeholder, chosen, inner, names_world
from .respelling import Respelling, respelt
from .rounds import Rounds, within
from .written_axes import WrittenAxes

Scope: TypeAlias = Mapping[str, Kind]

_OPENING = "${{"
_VARIABLE = re.compile(r"\$\{\{\s*(\w+)\s*\}\}")
"""Pattern of a text that is the value of one variable."""
_ANY_NAME = ""
"""Name in a scope that stands for a variable whose name is unknown."""
_MADE_TWICE = (
    "a list is made by forEach or by axes, not by both; to have both, make what forEach goes through an axis: "
    'axes: {item: {values: "${{ step.list }}"}}'
)
_ROOMS: Location = ("Buildings", 0, "Floors", 0, "Floorplan", "Rooms")
TEMPLATE_BODY = "templateBody"
_ROLE = "iamRole"


@dataclass
class InputCheck:
    """Checks the input of one step of a specification, before anything runs."""

    operation: str | None
    """Name of the operation; `None`: unknown, so that only references are checked."""
    node: Node
    """Input; after the check, misspelt members have the names that were probably meant."""
    scope: Scope
    location: Location
    """Keys that lead to the input in the file."""

    place: Place
    """Place in the file where the input begins: at its key."""

    problems: list[Problem] = field(default_factory=list[Problem])
    names: set[str] = field(default_factory=set[str])
    """Names of the steps to which it refers."""

    worlds: list[NamedWorld] = field(default_factory=list[NamedWorld])
    """Worlds that are not named by their ARNs."""

    _world_variables: set[str] = field(default_factory=set[str])
    """Names of axes, and of variables of a `forEach`, whose values are worlds."""

    _references: list[Location] = field(default_factory=list[Location])
    _wrong_names: set[str] = field(default_factory=set[str])
    """Invalid variable names; errors of references to them are ignored."""
    _respelling: Respelling | None = None

    def run(self) -> "InputCheck":
        """Collects a step's input's problems and the earlier steps that it refers to, in itself, which it returns."""
        model = None if self.operation is None else STEPS[self.operation].request
        self._respelling = respelt(self.node, model or Any, {TEMPLATE_BODY: WorldTemplateBody})
        self.node = self._respelling.node if model is None else _with_role(self._respelling.node, model)
        for written in self._respelling.written:
            hint = f"unknown member; did you mean {json.dumps(written[-1])}?"
            if written[0] != TEMPLATE_BODY or len(written) == 1:
                hint = f"is not known; did you mean {written[-1]!r}?"
            self._report_at(written, hint, at_key=True)
        request = self._walk(self.node, (), model or Any, self.scope)
        if model is not None and is_object(request):
            rounds = Rounds(model, self._checked, request, [*self._references])
            self.problems.extend(self._placed(problem, rounds.guessed) for problem in rounds.run())
            if TEMPLATE_BODY in model.model_fields and TEMPLATE_BODY in request:
                self._check_body(request[TEMPLATE_BODY])
        return self

    def _report(self, location: Location, message: str, *, at_key: bool = False) -> None:
        """Adds a problem at a location of the request to the list."""
        self._report_at(as_written(self.node, location), message, at_key=at_key)

    def _report_at(self, written: Location, message: str, *, at_key: bool = False) -> None:
        place = key_place(self.node, written) if at_key else value_place(self.node, written)
        self.problems.append(Problem(place, self._path(written), message))

    def _path(self, written: Location) -> str:
        """Returns the path of a member, with the names in the file."""
        inside = written if self._respelling is None else self._respelling.path(written)
        return path_text((*self.location, *inside))

    # References

    def _walk(self, node: Node, location: Location, annotation: Any, scope: Scope) -> Any:
        """Converts a node of the request to plain values with placeholders; locations are those in the request."""
        if construct := for_each_of(node):
            return self._for_each(construct, location, annotation, scope)
        if is_axes_location(location) and (construct := axes_of(node)):
            return self._axes(construct, location, annotation, scope)
        if isinstance(node, MappingNode):
            tag = node.entries.get(KIND)
            annotation = chosen(annotation, tag.value if isinstance(tag, ScalarNode) else None)
            return {
                key: self._walk(value, (*location, key), _inner(annotation, key, value), scope)
                for key, value in node.entries.items()
            }
        if isinstance(node, ListNode):
            entry = inner(annotation, 0)
            return [self._walk(item, (*location, index), entry, scope) for index, item in enumerate(node.items)]
        return self._scalar(node, location, annotation, scope)

    def _scalar(self, node: ScalarNode, location: Location, annotation: Any, scope: Scope) -> Any:
        if not isinstance(node.value, str):
            return node.value
        kind = self._kind(node.value, location, scope)
        if names_world(annotation):
            if kind is None and self._name_world(node, as_written(self.node, location)):
                self._references.append(location)
                return Placeholder(annotation)
            if variable := _VARIABLE.fullmatch(node.value):
                self._world_variables.add(variable[1])
        if kind is None:
            return parse_template(node.value).value({}) if "$${{" in node.value else node.value
        wanted = kind_of(annotation)
        if not fits(kind, wanted):
            hint = "; to_string(…) makes text of it" if wanted == TEXT and isinstance(kind, Scalar) else ""
            self._report(location, f"{node.value} is {_described(kind)}; it has to be {_described(wanted)}{hint}")
        return Placeholder(annotation)

    def _name_world(self, node: Node, written: Location) -> bool:
        """Keeps a text that names a world by something else than its ARN; returns whether it is one."""
        name = node.value if isinstance(node, ScalarNode) else None
        if not isinstance(name, str) or not name or name.startswith("arn:") or _OPENING in name:
            return False
        self.worlds.append(NamedWorld(written, self._path(written), node.place, name))
        return True

    def _name_worlds(self, node: Node | None, written: Location) -> None:
        """Keeps the names of worlds in a list."""
        for index, item in enumerate(node.items if isinstance(node, ListNode) else ()):
            self._name_world(item, (*written, index))

    def _kind(self, text: str, location: Location, scope: Scope) -> Kind | None:
        """Returns the type of the value of a text with references; `None` for a text without references.

        A wrong reference is reported, and has any type.
        """
        try:
            template = parse_template(text)
            if not template.references:
                return None
            self._references.append(location)
            for reference in template.references:
                self.names |= reference.names()
            names = self.names if _ANY_NAME in scope else set[str]()
            return template.kind({**dict.fromkeys(names - scope.keys(), ANYTHING), **scope})
        except ReferenceMistake as mistake:
            self._references.append(location)
            if not any(name in text for name in self._wrong_names):
                self._report(location, str(mistake))
            return ANYTHING

    def _for_each(self, construct: MappingNode, location: Location, annotation: Any, scope: Scope) -> Any:
        if is_axes_location(location) and AXES in construct.entries:
            self._report_at(location, _MADE_TWICE)
            return self._unknown(location, annotation)
        problems = self._construct_problems(construct, scope)
        wanted = kind_of(annotation)
        if not isinstance(wanted, ListOf | Anything):
            problems.append(RequestProblem((), f"forEach makes a list; it has to be {_described(wanted)}"))
        for problem in problems:
            self._report((*location, *problem.location), problem.message, at_key=problem.about_key)
        item = self._source_item(construct.entries[FOR_EACH], (*location, FOR_EACH), scope)
        value = construct.entries.get("value")
        if value is None:
            return self._unknown(location, annotation)
        inner_scope = {**scope, **self._variables(construct, item, problems), INDEX: WHOLE_NUMBER}
        outer = self._world_variables - {variable_of(construct)}  # another list may have used the same name
        self._world_variables = set(outer)
        made = [self._walk(value, (*location, 0), inner(annotation, 0), inner_scope)]
        if variable_of(construct) in self._world_variables:
            self._name_worlds(construct.entries[FOR_EACH], (*as_written(self.node, location), FOR_EACH))
        self._world_variables.discard(variable_of(construct))
        return made

    def _axes(self, construct: MappingNode, location: Location, annotation: Any, scope: Scope) -> Any:
        """Returns the request of a job of axes, as the only item of a list; reports problems of the axes."""
        axes = WrittenAxes(construct, lambda text, at: self._kind(text, (*location, *at), scope))
        for problem in axes.problems(scope):
            self._report_at((*location, *problem.location), problem.message, at_key=problem.about_key)
        value = construct.entries.get(VALUE)
        if value is None:
            self._report_at(location, "axes need a value: the request of each job")
            return self._unknown(location, annotation)
        for name in clashing_axes([*axes.kinds], plain(value) if isinstance(value, MappingNode) else {}):
            self._report_at((*location, VALUE, "trials", "axes", name), clashing_words(name), at_key=True)
        self._world_variables -= axes.kinds.keys()
        made = self._walk(value, (*location, 0), inner(annotation, 0), {**scope, **axes.kinds})
        for name in self._world_variables & axes.kinds.keys():
            at = (AXES, name, "values")
            self._name_worlds(node_at(construct, at), (*location, *at))
            for cells in ("include", "exclude"):
                listed = construct.entries.get(cells)
                for index, cell in enumerate(listed.items if isinstance(listed, ListNode) else ()):
                    if (world := child(cell, name)) is not None:
                        self._name_world(world, (*location, cells, index, name))
        for name in axes.kinds.keys() - self.names:
            words = f"nothing in value refers to it, so that its jobs would be the same; write ${{{{ {name} }}}} there"
            self._report_at((*location, "axes", name), words, at_key=True)
        return [made]

    def _variables(self, construct: MappingNode, item: Kind, problems: list[RequestProblem]) -> dict[str, Kind]:
        """Returns the variables that a `forEach` defines; of an invalid one, only their existence."""
        variable = variable_of(construct)
        if any(problem.location == ("as",) for problem in problems):
            self._wrong_names |= set() if is_step_name(variable) else {variable}
            return {variable: ANYTHING, _ANY_NAME: ANYTHING}
        unknown = [each for key, each in construct.entries.items() if key not in FOR_EACH_KEYS]
        # One of these may have been meant to name the variable.
        named = {each.value: ANYTHING for each in unknown if isinstance(each, ScalarNode)}
        return {**{name: kind for name, kind in named.items() if isinstance(name, str)}, variable: item}

    def _unknown(self, location: Location, annotation: Any) -> Placeholder:
        """Makes a placeholder for a value that cannot be checked because of another error."""
        self._references.append(location)
        return Placeholder(annotation)

    def _construct_problems(self, construct: MappingNode, scope: Scope) -> list[RequestProblem]:
        problems = [
            RequestProblem(
                (key,), f"is not known{nearest(key, FOR_EACH_KEYS) or '; known are forEach, as, value'}", True
            )
            for key in construct.entries
            if key not in FOR_EACH_KEYS
        ]
        if "value" not in construct.entries and not any(nearest("value", [key]) for key in construct.entries):
            problems.append(RequestProblem((), "forEach needs a value: the entry to make for each of the list's"))
        variable = variable_of(construct)
        if not is_step_name(variable):
            problems.append(
                RequestProblem(
                    ("as",), f"is {variable!r}; letters, digits and _, with no digit in front, would be right"
                )
            )
        if variable in scope or variable in (INDEX, PARAMETERS):
            problems.append(RequestProblem(("as",), f"{variable!r} already means something else; choose another name"))
        return problems

    def _source_item(self, source: Node, location: Location, scope: Scope) -> Kind:
        """Returns the type of the items over which a `forEach` iterates; of a source that is no list, any type.

        Such a source is reported as a problem.
        """
        if isinstance(source, ListNode):
            self._walk(source, location, list, scope)
            return ANYTHING
        kind: Kind | None = None
        if isinstance(source, ScalarNode) and isinstance(source.value, str):
            kind = self._kind(source.value, location, scope)
        if kind is None or not isinstance(kind, ListOf | Anything):
            found = f"{source.value}, {_described(kind)}" if kind and isinstance(source, ScalarNode) else "neither"
            self._report(location, f"is {found}; it has to be a list or a reference to one: ${{{{ step.list }}}}")
        return kind.item if isinstance(kind, ListOf) else ANYTHING

    # The request

    def _checked(self, request: Any) -> list[RequestProblem]:
        operation = self.operation or ""
        return [
            replace(problem, location=part.location(problem.location))
            for part in parts_of(operation, request)
            for problem in check_request(operation, part.request)
        ]

    def _placed(self, problem: RequestProblem, guessed: Set[Location]) -> Problem:
        written = as_written(self.node, problem.location)
        found = node_at(self.node, written)
        message = problem.message
        if isinstance(found, ScalarNode) and is_folded(found):
            hint = "; to_string(…) makes text of it" if "has to be text" in message else ""
            message += f"{hint}; the value is that of {found.source}"
        elif isinstance(found, ScalarNode) and not isinstance(found.value, str | None) and "has to be text" in message:
            message += f'; put it in quotes: "{found.source}"'
        place = place_of(problem, self.node, self.place)
        if found is None and problem.location[:-1] in guessed:
            place = value_place(self.node, (*written[:-1], KIND))  # told after the kind that it follows from
        return Problem(place, self._path(written), message)

    def _check_body(self, body: Any) -> None:
        """Checks a template body that is written in the file, as a mapping or as JSON text, and reports its problems.

        A body that is neither is not checked here.
        """
        written = child(self.node, TEMPLATE_BODY)
        if isinstance(body, str):
            try:
                body = load_strict(body, TEMPLATE_BODY, MAX_BODY_CHARACTERS)
            except InvalidParameterException as error:
                self._report((TEMPLATE_BODY,), str(error))
                return
        elif not is_object(body):
            return
        document, wrapper = unwrapped(body)
        prefix = (TEMPLATE_BODY, TEMPLATE_BODY) if wrapper else (TEMPLATE_BODY,)
        unknown = [at[len(prefix) :] for at in self._references if within(at, prefix)]
        for problem in Rounds(WorldTemplateBody, body_problems, document, unknown, follows_from=_is_about_rooms).run():
            location = (*prefix, *problem.location)
            if isinstance(written, MappingNode):
                self._report(location, problem.message, at_key=problem.about_key)
            else:
                place = value_place(self.node, (TEMPLATE_BODY,))
                self.problems.append(Problem(place, self._path(location), problem.message))


def _with_role(node: Node, model: type[Shape]) -> Node:
    """Returns a request with the role of jobs that are given none, where the operation requires one."""
    member = model.model_fields.get(_ROLE)
    if member is None or not member.is_required() or not isinstance(node, MappingNode) or _ROLE in node.entries:
        return node
    role = ScalarNode(node.place, LOCAL_ROLE, LOCAL_ROLE)
    places = {**node.key_places, _ROLE: node.place}
    return replace(node, entries={**node.entries, _ROLE: role}, key_places=places)


def _inner(annotation: Any, key: str, value: Node) -> Any:
    """Returns the type annotation of a member; a template body may be a mapping although the API has its text."""
    is_body = key == TEMPLATE_BODY and isinstance(value, MappingNode) and kind_of(annotation) != TEXT
    return WorldTemplateBody if is_body and _has_body(annotation) else inner(annotation, key)


def _has_body(annotation: Any) -> bool:
    return isinstance(annotation, type) and TEMPLATE_BODY in getattr(annotation, "model_fields", ())


def _is_about_rooms(problem: RequestProblem, blamed: Location) -> bool:
    """Returns whether a problem of a template body may be caused by a wrong or unknown room name."""
    if "no such room" not in problem.message:
        return False
    return within(_ROOMS, blamed) or (within(blamed, _ROOMS) and blamed[len(_ROOMS) + 1 :] in ((), ("Name",)))


def _described(kind: Kind) -> str:
    return f"a list of {kind.item}" if isinstance(kind, ListOf) and isinstance(kind.item, Scalar) else str(kind)
