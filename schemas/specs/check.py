"""Parses a specification and finds all of its problems before anything runs."""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import PurePath
from typing import Any, TypeAlias, get_args

from pydantic import ValidationError

from ..known_failures import KnownFailure
from ..operations.registry import STEPS, operation_shape
from ..wire.errors import Place, Problem, SpecError
from ..wire.json_values import is_list
from ..wire.request_problems import Location, closest, first_words, nearest, path_text, problems_of
from .checking.application_names import application_notes
from .checking.impossible_goals import room_problems, world_count_problems
from .checking.inputs import InputCheck
from .checking.known_entries import known_notes
from .checking.missing_worlds import missing_world_problems
from .checking.respelling import respelt
from .checking.step_order import circles, in_order
from .parameter_folding import fold_parameters
from .parameters import (
    PARAMETERS,
    Parameter,
    ParameterValue,
    Settled,
    declaration_problems,
    kind_of_parameters,
    settle,
)
from .reference_typing import ANYTHING, Kind, Structure
from .sabotages import Sabotage, read_sabotages
from .specification import (
    IF_EXISTS,
    MAX_STEPS,
    CheckedSpec,
    CheckedStep,
    IfExists,
    NamedWorld,
    Spec,
    is_step_name,
    output_model,
)
from .yaml_nodes import MappingNode, Node, ScalarNode, child, key_place, parse, plain, value_place

_SURELY_MEANT = 0.9
"""Similarity of operation names from which the input is checked as that of the similar operation."""
_HEAD = ("version", "name", "description", "known", PARAMETERS)


def load_spec(
    text: str,
    filename: str,
    parameters: Mapping[str, Any] | None = None,
    *,
    is_complete: bool = True,
    most_worlds: int | None = None,
) -> CheckedSpec:
    """Parses and checks a specification file: a pipeline of steps, or a single operation.

    A single operation is a file with `operation` and either `input` or the request's members themselves.

    Each part is checked as far as it can be, whatever is wrong elsewhere; what only comes of another problem is left
    out.

    Args:
        text: The file's content, YAML or JSON.
        filename: File name for the places of problems.
        parameters: Parameter values by name: plain ones, `AsText`, or nodes of the file from which they are. The others
            have their defaults.
        is_complete: Whether each parameter has to have a value. An incomplete specification cannot run.
        most_worlds: Maximum number of worlds of one generation job; `None`: not checked.

    Raises:
        SpecError: With everything that is wrong.
    """
    spec, problems = read_as_far_as_possible(
        text, filename, parameters, is_complete=is_complete, most_worlds=most_worlds
    )
    return _without_problems(spec, problems)


def read_as_far_as_possible(
    text: str,
    filename: str,
    parameters: Mapping[str, Any] | None = None,
    *,
    is_complete: bool = True,
    most_worlds: int | None = None,
) -> tuple[CheckedSpec, list[Problem]]:
    """Reads a specification file as `load_spec` does, and returns what can be read of it, and all its problems.

    One that has problems cannot run: it has no order of steps, and its steps may have anything as input.

    Raises:
        SpecError: The text is no YAML, or no mapping.
    """
    given = _Given(parameters or {}, is_complete, most_worlds)
    root = parse(text, filename)
    if not isinstance(root, MappingNode):
        raise SpecError([Problem(root.place, "", "a specification is a mapping with version, name and steps")])
    if "operation" not in root.entries or "steps" in root.entries:
        return _Check(root, (), text, filename, given).run()
    operation = root.entries["operation"]
    if not isinstance(root.entries.get("input"), MappingNode):
        request = {key: node for key, node in root.entries.items() if key != "operation"}
        return _load_bare(MappingNode(root.place, request, root.key_places), operation, text, filename, given)
    step = {key: node for key, node in root.entries.items() if key not in _HEAD}
    head = {key: node for key, node in root.entries.items() if key in _HEAD}
    return _load_single(head, MappingNode(root.place, step, root.key_places), text, filename, (), given)


def declared_parameters(text: str) -> dict[str, Parameter]:
    """Returns the parameters that a specification declares, for a form; none if they cannot be read.

    Args:
        text: The specification, YAML or JSON, which may have problems.
    """
    try:
        found = child(parse(text, ""), PARAMETERS)
        return _declared(found)
    except (SpecError, ValidationError):
        return {}


def _declared(found: Node | None) -> dict[str, Parameter]:
    entries = found.entries if isinstance(found, MappingNode) else {}
    return {name: Parameter.model_validate(plain(node)) for name, node in entries.items()}


def _declared_well(found: Node | None) -> dict[str, Parameter]:
    """Returns the parameters of a specification whose declarations can be read; others are left out."""
    declared: dict[str, Parameter] = {}
    for name, node in found.entries.items() if isinstance(found, MappingNode) else ():
        with suppress(ValidationError):
            declared[name] = Parameter.model_validate(plain(node))
    return declared


def load_request(text: str, filename: str, operation: str) -> CheckedSpec:
    """Parses and checks the request of one operation, as AWS CLI's `--cli-input-json` and `--cli-input-yaml` take it.

    Args:
        text: The request, YAML or JSON.
        filename: File name for the places of problems.
        operation: The operation's name.

    Returns:
        A specification of one step.

    Raises:
        SpecError: With everything that is wrong with the request.
        InvalidParameterException: There is no operation of that name.
    """
    operation_shape(operation)
    root = parse(text, filename)
    if not isinstance(root, MappingNode):
        raise SpecError([Problem(root.place, "", f"a request of {operation} is a mapping")])
    return _without_problems(*_load_bare(root, ScalarNode(root.place, operation, operation), text, filename, _Given()))


def _without_problems(spec: CheckedSpec, problems: list[Problem]) -> CheckedSpec:
    if problems:
        raise SpecError(problems, spec.notes)
    return spec


_Found: TypeAlias = tuple[CheckedSpec, list[Problem]]
"""Specification as far as it can be read, and its problems."""


@dataclass(frozen=True)
class _Given:
    """Values that parameters were given, and limits, for the check of a specification."""

    values: Mapping[str, Any] = field(default_factory=dict[str, Any])
    is_complete: bool = True
    most_worlds: int | None = None


def _load_bare(request: MappingNode, operation: Node, text: str, filename: str, given: _Given) -> _Found:
    """Checks a request that is given without operation and input around it."""
    step = MappingNode(request.place, {"operation": operation, "input": request}, request.key_places)
    return _load_single({}, step, text, filename, ("input",), given)


def _load_single(
    head: Mapping[str, Node], step: MappingNode, text: str, filename: str, hidden: Location, given: _Given
) -> _Found:
    """Checks a single step, by putting a pipeline around it that is invisible to the user; its name is the file's."""
    stem = re.sub(r"[^a-zA-Z0-9_\-]+", "-", PurePath(filename).name.split(".")[0]).strip("-_")[:100] or "request"
    name = re.sub(r"\W|^(?=\d)", "_", stem)[:63]
    entries: dict[str, Node] = {
        "version": ScalarNode(step.place, 1, "1"),
        "name": ScalarNode(step.place, stem, stem),
        **head,
        "steps": MappingNode(step.place, {name: step}, {name: step.place}),
    }
    root = MappingNode(step.place, entries, {**step.key_places, "steps": step.place})
    return _Check(root, ("steps", name, *hidden), text, filename, given).run()


class _Check:
    """Check of one specification: parses it, collects its problems, and returns it if there are none."""

    def __init__(self, root: MappingNode, hidden: Location, text: str, filename: str, given: _Given) -> None:
        self._respelling = respelt(root, Spec)
        assert isinstance(self._respelling.node, MappingNode)
        self._root = self._respelling.node
        self._hidden = hidden
        """Prefix of all locations that the user did not write."""
        self._text = text
        self._filename = filename
        self._given = given
        self._declared: dict[str, Parameter] = {}
        self._parameters: Kind | None = None
        """Type of `parameters` in references; `None`: the file declares none."""
        self._settled = Settled()
        self._problems: list[Problem] = []

    def run(self) -> _Found:
        """Runs all checks of the specification and returns it with the notes on it, and its problems.

        Problems are in the order of the file.
        """
        self._check_document()
        self._settle_parameters()
        sabotages = self._sabotages()
        nodes = self._step_nodes()
        if len(nodes) > MAX_STEPS:
            nodes = {}  # which has been told, and would take long
        # A single step has nothing to refer to.
        referable = {} if self._hidden else {name: node for name, node in nodes.items() if name != PARAMETERS}
        scope = {name: _output_kind(node) for name, node in referable.items()}
        found = ((name, self._check_step(name, node, scope)) for name, node in nodes.items())
        steps = {name: step for name, step in found if step is not None}
        order = self._order(steps)
        self._problems.extend(room_problems(steps))
        self._problems.extend(missing_world_problems(steps))
        if (most := self._given.most_worlds) is not None:
            told = [each.path for each in self._problems]
            too_many = world_count_problems(steps, most)
            self._problems.extend(each for each in too_many if not any(path.startswith(each.path) for path in told))
        notes = tuple(application_notes(steps))
        problems = sorted(dict.fromkeys(self._problems), key=lambda problem: _position(problem.place))
        known = () if problems else self._known()
        named = {
            key: str(plain(self._root.entries[key])) for key in ("name", "description") if key in self._root.entries
        }
        spec = CheckedSpec(
            name=named.get("name", ""),
            description=named.get("description", ""),
            filename=self._filename,
            text=self._text,
            steps=steps,
            order=order,
            declared=self._declared,
            parameters=self._settled.values,
            missing=self._settled.missing,
            notes=(*notes, *known_notes(self._root, known, steps, datetime.now(UTC).date())),
            sabotages=sabotages,
            known=known,
        )
        return spec, problems

    def _known(self) -> tuple[KnownFailure, ...]:
        """The known failures of a document that has no problems."""
        found = self._root.entries.get("known")
        return tuple(map(KnownFailure.model_validate, plain(found))) if found is not None else ()

    def _sabotages(self) -> tuple[Sabotage, ...]:
        """Reads the sabotages of the specification, and reports the problems of invalid ones.

        A sabotage is a fault put into the robot, to see whether the requirements catch it. Entries that are no
        mappings were reported before.
        """
        found = self._root.entries.get("sabotages")
        if not isinstance(found, MappingNode) or not found.entries:
            return ()
        sabotages, problems = read_sabotages(plain(found))
        for each in problems:
            if len(each.location) != 1 or isinstance(child(found, each.location[0]), MappingNode) or each.about_key:
                self._report(("sabotages", *each.location), each.message, at_key=each.about_key or not each.location)
        return tuple(sabotages)

    def _settle_parameters(self) -> None:
        """Checks what is declared, gives each parameter its value, and puts the values in place of their references.

        Of a parameter with a wrong declaration nothing more is known than that it is there: nothing is said of its
        value, and references to it may be of any type.
        """
        found = self._root.entries.get(PARAMETERS, MappingNode(self._root.place, {}, {}))
        if not isinstance(found, MappingNode):
            self._parameters = ANYTHING
            return
        readable = _declared_well(found)
        problems = [each for name, declared in readable.items() for each in declaration_problems(name, declared)]
        wrong = {each.location[1] for each in problems}
        self._declared = {name: declared for name, declared in readable.items() if name not in wrong}
        unknown = {name: ANYTHING for name in found.entries if name not in self._declared}
        given = {name: value for name, value in self._given.values.items() if name not in unknown}
        self._settled = settle(self._declared, given, is_complete=self._given.is_complete, others=tuple(unknown))
        kinds = kind_of_parameters(self._declared, unknown)
        self._parameters = kinds if PARAMETERS in self._root.entries else None
        # Where one has no value, what refers to it is checked by its type.
        self._root, more = fold_parameters(self._root, kinds, self._settled.values)
        for each in (*problems, *self._settled.problems, *more):
            place = each.place or (key_place if each.about_key else value_place)(self._root, each.location)
            self._problems.append(Problem(place, self._path(each.location), each.message))

    def _report(self, location: Location, message: str, *, at_key: bool = False) -> None:
        place = (key_place if at_key else value_place)(self._root, location)
        self._problems.append(Problem(place, self._path(location), message))

    def _path(self, location: Location) -> str:
        return path_text(self._shown(location))

    def _shown(self, location: Location) -> Location:
        """Converts a location in the checked specification to the one in the user's file."""
        written = self._respelling.path(location)
        return written[len(self._hidden) :] if location[: len(self._hidden)] == self._hidden else written

    def _check_document(self) -> None:
        for location in self._respelling.written:
            self._report(location, f"is not known; did you mean {location[-1]!r}?", at_key=True)
        try:
            Spec.model_validate(plain(self._root))
        except ValidationError as error:
            for problem in problems_of(error, Spec):
                self._report(problem.location, problem.message, at_key=problem.about_key)

    def _step_nodes(self) -> dict[str, Node]:
        steps = self._root.entries.get("steps")
        if isinstance(steps, MappingNode) and PARAMETERS in steps.entries:
            words = f"no step may be named {PARAMETERS!r}, which references reach parameters by; choose another name"
            self._report(("steps", PARAMETERS), words, at_key=True)
            self._parameters = self._parameters or ANYTHING
        return dict(steps.entries) if isinstance(steps, MappingNode) else {}

    def _check_step(self, name: str, node: Node, scope: Mapping[str, Kind]) -> CheckedStep | None:
        if not isinstance(node, MappingNode):
            return None
        location: Location = ("steps", name)
        said, operation = _said_operation(node), _operation(node)
        needs = self._check_needs(name, node, scope)
        if said is not None and said not in STEPS:
            hint = nearest(said, STEPS) or f"; there are {', '.join(sorted(STEPS))}"
            self._report((*location, "operation"), f"there is no operation {said!r}{hint}")
        if_exists = _if_exists(node, operation)
        if (wrong := _wrong_if_exists(if_exists, operation)) is not None:
            self._report((*location, "ifExists"), wrong)
        place = key_place(self._root, (*location, "input" if "input" in node.entries else "operation"))
        shown = self._shown((*location, "input"))
        request = node.entries.get("input", MappingNode(place, {}, {}))
        parameters: Mapping[str, ParameterValue] = {}
        worlds: tuple[NamedWorld, ...] = ()
        if isinstance(request, MappingNode):
            known = {} if self._parameters is None else {PARAMETERS: self._parameters}
            check = InputCheck(operation, request, {**scope, **known}, shown, place).run()
            self._problems.extend(check.problems)
            request, worlds = check.node, tuple(check.worlds)
            needs |= check.names & scope.keys()
            parameters = self._settled.values if PARAMETERS in check.names else {}
        return CheckedStep(
            name=name,
            operation=operation or "",
            input=request,
            needs=tuple(each for each in scope if each in needs) if needs else (),
            if_exists=if_exists,
            location=shown,
            place=place,
            worlds=worlds,
            parameters=parameters,
        )

    def _check_needs(self, name: str, node: MappingNode, scope: Mapping[str, Kind]) -> set[str]:
        """Returns the steps that a step names in its member `needs`, and reports those that do not exist."""
        named: Any = plain(node.entries["needs"]) if "needs" in node.entries else ()
        found: set[str] = set()
        for position, each in enumerate(named if is_list(named) else []):
            if isinstance(each, str) and each not in scope:
                if not is_step_name(each) or (each == PARAMETERS and self._parameters is ANYTHING):
                    continue  # that has been told already
                hint = nearest(each, scope) or f"; there are {first_words(scope)}"
                self._report(("steps", name, "needs", position), f"there is no step {each!r}{hint}")
            elif each == name:
                self._report(("steps", name, "needs", position), "needs itself; leave it out")
            elif isinstance(each, str):
                found.add(each)
        return found

    def _order(self, steps: Mapping[str, CheckedStep]) -> tuple[str, ...]:
        """Returns the steps, each after those it needs, otherwise in file order; empty if there are problems.

        Steps that wait for each other are reported.
        """
        graph = {name: [each for each in step.needs if each in steps] for name, step in steps.items()}
        for circle in circles(graph):
            message = (
                "refers to itself" if len(circle) == 2 else f"these steps wait for each other: {' -> '.join(circle)}"
            )
            self._report(("steps", circle[0]), message, at_key=True)
        return () if self._problems else in_order(graph)


def _output_kind(step: Node) -> Kind:
    operation = _operation(step)
    return ANYTHING if operation is None else Structure(output_model(operation))


def _said_operation(step: Node) -> str | None:
    operation = _scalar(step, "operation")
    return operation if isinstance(operation, str) else None


def _operation(step: Node) -> str | None:
    """Returns the operation that a step names, or nearly names; `None` if it cannot be determined."""
    said = _said_operation(step)
    return None if said is None else said if said in STEPS else closest(said, STEPS, _SURELY_MEANT)


def _scalar(step: Node, key: str) -> Any:
    node = child(step, key)
    return node.value if isinstance(node, ScalarNode) else None


def _if_exists(step: MappingNode, operation: str | None) -> IfExists:
    """Returns the value of a step's `ifExists`, else that which counts where nothing is said."""
    said = _scalar(step, "ifExists")
    return said if said in get_args(IfExists) else IF_EXISTS.get(operation or "", ("fail",))[0]


def _wrong_if_exists(if_exists: IfExists, operation: str | None) -> str | None:
    """The reason why an operation has no such value of `ifExists`; `None`: it has."""
    known = IF_EXISTS.get(operation or "")
    if operation is None or if_exists in (known or ("fail",)):
        return None
    if known is not None:
        return f"{if_exists!r} is not for {operation}; {' or '.join(map(repr, known))} would be right"
    owners = [name for name, values in IF_EXISTS.items() if if_exists in values]
    return f"{if_exists!r} is for {' and '.join(sorted(owners))}; remove it"


def _position(place: Place) -> tuple[int, int]:
    return place.line, place.column
