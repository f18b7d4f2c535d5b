"""Specifications: small pipelines of operations, written in YAML.

```yaml
version: 1
name: two-flats
steps:
  template: {operation: CreateWorldTemplate, input: {name: flat, templateBody: {…}}}
  worlds:
    operation: CreateWorldGenerationJob
    input: {template: "${{ template.arn }}", worldCount: {floorplanCount: 2, interiorCountPerFloorplan: 1}}
```

This module has the document's models and what a checked specification is; `check.load_spec`
makes one from text. What a step gives to later ones is its operation's response; a job gives its final
`Describe…` response.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

from pydantic import Field

from ..known_failures import KnownFailure
from ..operations.registry import STEPS
from ..runs.variables import hide_secrets
from ..wire.base import Model, Shape, optional
from ..wire.common import text
from ..wire.errors import Place, Problem
from ..wire.request_problems import Location, RequestProblem
from .parameters import MAX_PARAMETERS, Parameter, ParameterValue
from .sabotages import Sabotage
from .step_axes import AXES, SEEDS
from .yaml_nodes import ListNode, MappingNode, Node, ScalarNode, child, key_place, parse, plain, value_place

_NAME = r"[a-zA-Z_][a-zA-Z0-9_]*"
StepName = Annotated[str, text(1, 63, _NAME)]
ParameterName = Annotated[str, text(1, 63, _NAME)]
_SPEC_NAME = r"[a-zA-Z0-9][a-zA-Z0-9_\-]{0,99}"
SpecName = Annotated[str, text(1, 100, _SPEC_NAME)]
IfExists = Literal["fail", "reuse", "update"]

MAX_STEPS = 1000
"""Maximum number of steps of a specification, since each is a flow run. Many jobs are a batch's requests, or a
campaign's, in one step.
"""

FOR_EACH = "forEach"
FOR_EACH_KEYS = (FOR_EACH, "as", "value")
INDEX = "index"
DEFAULT_VARIABLE = "item"

IF_EXISTS: Mapping[str, tuple[IfExists, ...]] = {
    "CreateRobotApplication": ("fail", "reuse", "update"),
    "CreateSimulationApplication": ("fail", "reuse", "update"),
    # Names of templates may repeat, and a body that did not change needs no second one.
    "CreateWorldTemplate": ("reuse", "fail"),
}
"""Values of `ifExists` by operation; the first is the one that counts where nothing is said."""


class Step(Model):
    """A step of a specification's pipeline: an operation with its input."""

    operation: str = Field(description="The operation to call, by the service's name: `CreateWorldGenerationJob`.")
    input: dict[str, Any] = Field(
        default={},
        description="The operation's request. Values may be references `${{ step.member }}` to what earlier steps "
        "gave, or `${{ parameters.name }}`; a list may be written as `{forEach: ${{ … }}, as: name, value: …}`.",
    )
    needs: list[StepName] = Field(
        default=[], description="Steps that have to end before this one; those it refers to are added by themselves."
    )
    ifExists: IfExists | None = optional(
        "For Create…Application and CreateWorldTemplate: what to do when the name is taken; `reuse` takes the one "
        "there is if it is identical, `update` (of applications) makes it what the input says, with its archive as it "
        "is now, `fail` refuses. Absent: `fail` for applications; `reuse` for templates, of which another body is "
        "made anew."
    )


class Spec(Model):
    """A specification: a named pipeline of steps that generate worlds and run simulations."""

    version: Literal[1] = Field(description="Version of this form; 1.")
    name: SpecName = Field(description="The pipeline's name, part of the run's folder and the report's title.")
    description: str = Field(default="", description="Purpose of the pipeline, in words.")
    parameters: dict[ParameterName, Parameter] = Field(
        default={},
        max_length=MAX_PARAMETERS,
        description="Values that each run may be given anew, by name; inputs of steps refer to them as "
        "`${{ parameters.name }}`.",
    )
    sabotages: dict[str, dict[str, Any]] = Field(
        default={},
        description="Sabotages that `robomaker challenge` tries besides its own, by name: values of axes, "
        "`slippery: {robot_friction: 0.2}`. Runs do without them.",
    )
    known: list[KnownFailure] = Field(
        default=[],
        max_length=100,
        description="Failures that are known: these jobs are run and judged, and shown apart, but do not make a run "
        "red until a day.",
    )
    steps: dict[StepName, Step] = Field(
        min_length=1, max_length=MAX_STEPS, description="The steps by name, in any order."
    )


@dataclass(frozen=True)
class NamedWorld:
    """World that a step's input names by something else than its ARN."""

    location: Location
    """Keys that lead to the name in the step's input, as written."""

    path: str
    """Path of the name in the file: `steps.drive.input.worlds[0]`."""

    place: Place
    name: str
    """Name of a world, its id or the beginning of that."""


@dataclass(frozen=True)
class CheckedStep:
    """A step of a specification whose input has been checked, as far as possible before anything runs."""

    name: str
    operation: str
    input: Node
    """Request with unresolved references; `resolving.resolve_input` resolves them."""

    needs: tuple[str, ...]
    """Names of all steps that have to end before: those it names and those it refers to, in file order."""

    if_exists: IfExists
    location: Location
    """Keys that lead to the input in the file."""

    place: Place
    """Place in the file where the input begins: at its key."""

    worlds: tuple[NamedWorld, ...] = ()
    """Worlds that are not named by their ARNs; a run puts those in their place."""

    parameters: Mapping[str, ParameterValue] = field(default_factory=dict[str, ParameterValue])
    """Parameters of the specification that references in the input need in addition to outputs of steps."""


@dataclass(frozen=True)
class CheckedSpec:
    """A specification without errors, ready to run."""

    name: str
    description: str
    filename: str
    text: str
    """Content of the file."""

    steps: Mapping[str, CheckedStep]
    """Steps by name, in file order."""

    order: tuple[str, ...]
    """Names of the steps in execution order, each after those it needs."""

    declared: Mapping[str, Parameter] = field(default_factory=dict[str, Parameter])
    """Parameters as the file declares them."""

    parameters: Mapping[str, ParameterValue] = field(default_factory=dict[str, ParameterValue])
    """Values of the parameters, defaults included."""

    missing: tuple[str, ...] = ()
    """Names of parameters without a value, which a run needs."""

    notes: tuple[Problem, ...] = ()
    """Possible mistakes: names that only the catalog may know."""
    sabotages: tuple[Sabotage, ...] = ()
    """Sabotages of the specification, which `robomaker challenge` tries."""

    known: tuple[KnownFailure, ...] = ()
    """Failures that do not make a run red."""

    seed: int | None = None
    """Seed that replaces those in the file; `None`: those in the file are used."""

    found_worlds: Mapping[str, str] = field(default_factory=dict[str, str])
    """ARNs of the worlds that the file names by something else, by name; they are in the steps' inputs already."""

    @property
    def text_for_others(self) -> str:
        """The specification file's text without secrets, to show it to others; as JSON if secrets had to be removed."""
        inputs = [plain(step.input) for step in self.steps.values()]
        if hide_secrets(inputs) is inputs:
            return self.text
        return json.dumps(hide_secrets(plain(parse(self.text, self.filename))), indent=2, ensure_ascii=False) + "\n"


def output_model(operation: str) -> type[Shape]:
    """Returns the model of an operation's output, which later steps of a specification can refer to."""
    return STEPS[STEPS[operation].final_name].response


def place_of(problem: RequestProblem, node: Node, outermost: Place) -> Place:
    """Finds the line and column in the specification file that a problem of a request is about.

    Args:
        problem: Problem of the request.
        node: The request as written.
        outermost: Place where the whole request begins.
    """
    written = as_written(node, problem.location)
    if problem.about_key:
        return key_place(node, written)
    if not written or (len(written) == 1 and child(node, written[0]) is None):
        return outermost
    return value_place(node, written)


def for_each_of(node: Node) -> MappingNode | None:
    """Returns the node if it is a `forEach` construct of a specification, else `None`."""
    return node if isinstance(node, MappingNode) and FOR_EACH in node.entries else None


def axes_of(node: Node) -> MappingNode | None:
    """Returns the node if it is axes of a step, in place of a list of job requests, else `None`."""
    if not isinstance(node, MappingNode) or FOR_EACH in node.entries:
        return None
    return node if AXES in node.entries or SEEDS in node.entries else None


def made_list_of(node: Node) -> MappingNode | None:
    """Returns the node if it makes a list by `forEach` or by axes, else `None`; `value` is what it makes it of."""
    return for_each_of(node) or axes_of(node)


def is_step_name(name: str) -> bool:
    """Returns whether a name is allowed for a step or a variable of a specification."""
    return re.fullmatch(_NAME, name) is not None


def is_spec_name(name: str) -> bool:
    """Returns whether a name is allowed for a specification."""
    return re.fullmatch(_SPEC_NAME, name) is not None


def variable_of(construct: MappingNode) -> str:
    """Returns the name of the loop variable of a `forEach` construct."""
    return str(plain(construct.entries["as"])) if "as" in construct.entries else DEFAULT_VARIABLE


def with_seed(spec: CheckedSpec, seed: int) -> CheckedSpec:
    """Returns the specification with another random seed in all its requests, also those inside a batch."""
    steps = {name: replace(step, input=_seeded(step, seed)) for name, step in spec.steps.items()}
    return replace(spec, steps=steps, seed=seed)


def _seeded(step: CheckedStep, seed: int) -> Node:
    value = ScalarNode(step.place, seed, str(seed))
    if "seed" in STEPS[step.operation].request.model_fields:
        return _with_entry(step.input, "seed", value)
    requests = child(step.input, "createSimulationJobRequests")
    if (construct := requests and made_list_of(requests)) and "value" in construct.entries:
        seeded: Node = _with_entry(construct, "value", _with_entry(construct.entries["value"], "seed", value))
    elif isinstance(requests, ListNode):
        seeded = ListNode(requests.place, tuple(_with_entry(item, "seed", value) for item in requests.items))
    else:
        return step.input
    return _with_entry(step.input, "createSimulationJobRequests", seeded)


def _with_entry(node: Node, key: str, value: Node) -> Node:
    return replace(node, entries={**node.entries, key: value}) if isinstance(node, MappingNode) else node


def as_written(node: Node, location: Location) -> Location:
    """Maps a location in the resolved request to the location in the file.

    Entries that one `forEach`, or one step's axes, made share one origin.
    """
    written: list[str | int] = []
    following: Node | None = node
    for step in location:
        made = following is not None and isinstance(step, int) and made_list_of(following)
        written.append("value" if made else step)
        following = child(following, written[-1]) if following is not None else None
    return tuple(written)
