"""Axes of a step: job requests, one for each cell and seed, in place of a list that is written by hand.

```yaml
createSimulationJobRequests:
  axes:
    robot: {values: [scout, rover]}
    world: {values: "${{ worlds.finishedWorldsSummary.succeededWorlds }}"}
  seeds: 3
  value: {…, robotApplications: [{application: "${{ robot }}", launchConfig: {}}]}
```

Members and designs are those of trials. What an axis varies is where its name stands, so it has no kind. Each job says
its cell in its tags, which keep it through batches, reruns and records.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, overload

from pydantic import AfterValidator, Field, ValidationError, WithJsonSchema

from ..runs.axes import AXIS_TAG, MAX_AXES, tag_value
from ..runs.axis_kinds.kind import MAX_VALUES, AxisRange, NormalDistribution, NumberAxis, Rig, Setter, repeated_words
from ..runs.trial_designs import CellAxis, Cells, TrialDesign
from ..runs.trials import trials_seeds
from ..runs.variables import secret_names
from ..wire.base import Model, optional
from ..wire.common import MAX_SEED
from ..wire.json_values import is_list, is_mapping
from ..wire.request_problems import Location, RequestProblem, nearest, placed_by_its_path, problems_of

AXES = "axes"
SEEDS = "seeds"
VALUE = "value"
AXES_KEYS = (AXES, "design", "points", "include", "exclude", SEEDS, VALUE)
MAX_JOBS = 100_000
"""Limit on the jobs of a step: all their requests are in memory together, at a few kilobytes each."""
_MAX_TAG_CHARACTERS = 256
"""Maximum number of characters of an axis's value, which is the value of a tag."""

Scalar: TypeAlias = str | int | float | bool
StepCell = Mapping[str, Scalar]
"""Values of all axes by name."""


def _scalar(value: Any) -> Scalar:
    if not isinstance(value, str | int | float):
        shown = "null" if value is None else "a mapping" if is_mapping(value) else "a list"
        raise ValueError(f"is {shown}; a text, a number, true or false would be right")
    return value


ScalarValue = Annotated[Any, AfterValidator(_scalar), WithJsonSchema({"type": ["string", "number", "boolean"]})]
AxisCount = Annotated[int, Field(ge=1, le=MAX_JOBS)]


class StepAxis(Model):
    """One axis of a step: values that its jobs have in turn, wherever `${{ name }}` stands in `value`."""

    values: list[ScalarValue] | None = Field(
        default=None,
        min_length=1,
        max_length=MAX_VALUES,
        description="Its values: texts, numbers, true or false; a list, or a reference to one.",
    )
    range: AxisRange | None = optional("Least and largest value; all between are equally likely.")
    normal: NormalDistribution | None = optional("Normal distribution of its values.")


class StepAxes(Model):
    """Axes of a step with their design: the members of a step's trials, and the request that each job has."""

    axes: dict[str, StepAxis] = Field(
        default={}, max_length=MAX_AXES, description="The axes by name, which references in `value` use."
    )
    design: TrialDesign = Field(default="grid", description="How cells are chosen, as of trials.")
    points: AxisCount | None = optional("How many cells there are, of a design that is no grid.")
    include: list[dict[str, ScalarValue]] | None = Field(
        default=None, max_length=MAX_VALUES, description="Cells beside those of the design: a value of each axis."
    )
    exclude: list[dict[str, ScalarValue]] | None = Field(
        default=None, max_length=MAX_VALUES, description="Cells that a grid does without: values of all axes or some."
    )
    seeds: AxisCount = Field(
        default=1,
        description="How many jobs there are of each cell: with the seed of `value`, 0 unless it gives one, and with "
        "those after it; the same ones in each cell.",
    )
    value: dict[str, Any] = Field(description="The request of each job, which refers to axes by their names.")


class _SpreadAxis(NumberAxis):
    """A range or a distribution of numbers of any unit."""

    varies: ClassVar[str] = "any number"
    applies_to: ClassVar[str] = "steps"
    unit: ClassVar[str] = ""
    # Wide enough for every quantity there is, and a bound for normal distributions, which need one.
    least, most = -1e12, 1e12
    neutral: ClassVar[str] = ""

    kind: Literal["an axis of a step"] = Field(default="an axis of a step", description="Word for it in messages.")

    @classmethod
    def bind(cls, rig: Rig) -> Setter:
        """Raises NotImplementedError: references bring the values of such an axis into requests."""
        raise NotImplementedError

    def parse(self, text: Any) -> float:
        """Returns the number that a cell's text or value means; ValueError if it is none that fits the axis."""
        return super().parse(text if isinstance(text, str) else repr(text))


@dataclass(frozen=True)
class _ListedAxis:
    """An axis that lists its values, of any type."""

    values: Sequence[Scalar]

    @property
    def listed(self) -> Sequence[Scalar]:
        """The values of an axis that lists them."""
        return self.values

    def parse(self, text: Any) -> Scalar:
        """Returns the value of a cell as it is.

        Raises:
            ValueError: It is too long for a tag, or is 1 where the axis has true.
        """
        _check_length(text)
        _check_truth([*self.values, text])
        return text

    def at(self, share: float) -> Scalar:
        """Returns the value at a quantile, 0 to 1; all values are equally likely."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]


class _EveryValue(Sequence[Scalar]):
    """Values of an axis that is wrong itself: which ones it should have is not known, so that each is one of them."""

    def __len__(self) -> int:
        return 1

    @overload
    def __getitem__(self, index: int) -> Scalar: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Scalar]: ...

    def __getitem__(self, index: int | slice) -> Scalar | Sequence[Scalar]:
        """Returns no value that anything depends on."""
        return self if isinstance(index, slice) else ""

    def __contains__(self, value: object) -> bool:
        return True


class _UnreadAxis(_ListedAxis):
    """Stand-in for an axis that is wrong itself, beside which other axes and cells are checked."""

    def __init__(self) -> None:
        super().__init__(_EveryValue())

    def parse(self, text: Any) -> Scalar:
        """Returns the value of a cell as it is."""
        return text


def axes_problems(written: Mapping[str, Any]) -> tuple[Cells | None, list[RequestProblem]]:
    """Checks axes of a step whose values are known.

    Args:
        written: The construct as plain values, references resolved; its `value` is not looked at.

    Returns:
        Its cells and no problems if all is right, else `None` and the problems, located inside the construct.
    """
    problems: list[RequestProblem] = []
    wrong: set[Location] = set()
    try:
        found = StepAxes.model_validate({**written, VALUE: {}})
    except ValidationError as error:
        problems = [_about_kind(each) for each in problems_of(error, StepAxes)]
        wrong = {each.location[: 2 if each.location[:1] in _WITH_PARTS else 1] for each in problems}
        try:
            found = StepAxes.model_validate({**_readable(written, wrong), VALUE: {}})
        except ValidationError:  # it has more problems than are told
            return None, problems
    axes, wrong_axes = _built(found.axes)
    problems += wrong_axes
    unread = found.axes.keys() - axes.keys() | {str(name) for key, *rest in wrong if key == AXES for name in rest}
    cells = Cells(
        axes={**axes, **{name: _UnreadAxis() for name in unread}},
        design="random" if ("design",) in wrong else found.design,  # which has no rule about excluded values
        points=found.points,
        include=found.include or (),
        exclude=found.exclude or (),
        seeds=found.seeds,
        most=MAX_JOBS,
        counted="jobs",
        holder="a step",
    )
    members = {str(each.location[0]) for each in problems if each.location}
    told = [placed_by_its_path(line, (), written) for line in cells.problems(members)]
    told += _incomplete(found, cells.axes.keys())
    problems += (each for each in told if each.location[:2] not in wrong)
    return (None, problems) if problems else (cells, [])


_WITH_PARTS = ((AXES,), ("include",), ("exclude",))
"""Members of which only a part is left out if it is wrong: an axis, or a cell."""


def _readable(written: Mapping[str, Any], wrong: Set[Location]) -> dict[str, Any]:
    """Returns axes of a step without the parts that are wrong; cells keep their positions."""
    kept = {key: value for key, value in written.items() if (key,) not in wrong}
    if is_mapping(axes := kept.get(AXES)):
        kept[AXES] = {name: axis for name, axis in axes.items() if (AXES, name) not in wrong}
    for key in ("include", "exclude"):
        if is_list(cells := kept.get(key)):
            kept[key] = [{} if (key, number) in wrong else cell for number, cell in enumerate(cells)]
    return kept


def _built(axes: Mapping[str, StepAxis]) -> tuple[dict[str, CellAxis], list[RequestProblem]]:
    """Returns the axes of a step as designs know them, and the problems of the others, which are left out."""
    built: dict[str, CellAxis] = {}
    problems = _secrets(axes)
    for name, axis in axes.items():
        try:
            built[name] = _axis(axis)
        except ValueError as error:
            problems += _axis_problems(name, error)
    return built, problems


def _secrets(names: Mapping[str, Any]) -> list[RequestProblem]:
    """Finds axes whose names say that they are secrets: values of axes are in tags, tables and reports."""
    words = "its name says that it is a secret, and values of axes are in tables and reports; give it for all jobs"
    return [RequestProblem((AXES, name), words, about_key=True) for name in sorted(secret_names({}, names))]


def _axis(axis: StepAxis) -> CellAxis:
    given = [name for name in ("values", "range", "normal") if getattr(axis, name) is not None]
    if given == ["values"] and axis.values is not None:
        _check_different(axis.values)
        try:
            _check_truth(axis.values)
            for value in axis.values:
                _check_length(value)
        except ValueError as error:
            raise ValueError(f"values: {error}") from None
        return _ListedAxis(axis.values)
    return _SpreadAxis(range=axis.range, normal=axis.normal, values=None if axis.values is None else ["0"])


def _check_different(values: Sequence[Scalar]) -> None:
    """Raises ValueError for values that occur twice; it says them as the file does."""
    keys = [_key(value) for value in values]
    written = dict(zip(keys, values, strict=True))
    if twice := sorted(key for key in written if keys.count(key) > 1):
        shown = (written[key] for key in twice)
        raise ValueError(repeated_words(repr(each) if isinstance(each, str) else tag_value(each) for each in shown))


def _check_length(value: Scalar) -> None:
    if len(tag_value(value)) > _MAX_TAG_CHARACTERS:
        raise ValueError(
            f"{str(value)[:40]}… is too long: a value is a tag of its job, of {_MAX_TAG_CHARACTERS} characters; give "
            "it a short name, and look up the rest by that"
        )


def _check_truth(values: Sequence[Scalar]) -> None:
    """Raises ValueError for true beside 1, or false beside 0: Python takes them for equal."""
    for value in values:
        if isinstance(value, bool) and any(other == value and not isinstance(other, bool) for other in values):
            raise ValueError(f"{tag_value(value)} and {int(value)} are taken for each other; write one of them")


def _key(value: Scalar) -> str:
    """Returns a text that is the same for values by which cells could not be told apart, such as 1 and 1.0."""
    return (
        tag_value(float(value)) if isinstance(value, int | float) and not isinstance(value, bool) else tag_value(value)
    )


def _axis_problems(name: str, error: ValueError) -> list[RequestProblem]:
    if isinstance(error, ValidationError):
        return [RequestProblem((AXES, name, *each.location), each.message) for each in problems_of(error, _SpreadAxis)]
    return [RequestProblem((AXES, name), str(error))]


def _about_kind(problem: RequestProblem) -> RequestProblem:
    """Returns a problem of a step's axes; one about a `kind` says instead that axes of a step have none."""
    if problem.about_key and problem.location[:1] == (AXES,) and problem.location[2:] == ("kind",):
        name = problem.location[1]
        words = f"axes of a step have no kind: what it varies is where ${{{{ {name} }}}} stands in value; leave it out"
        return RequestProblem(problem.location, words, about_key=True)
    return problem


def _incomplete(found: StepAxes, names: Set[str]) -> list[RequestProblem]:
    """Finds included cells without a value for some axis, whose references would have none."""
    return [
        RequestProblem(("include", number), f"has no value of {', '.join(missing)}; a cell of a step has all axes")
        for number, cell in enumerate(found.include or ())
        if (missing := [name for name in names if name not in cell and not nearest(name, cell.keys() - names)])
    ]


def cells_of(cells: Cells, seed: int) -> list[tuple[StepCell, int]]:
    """Returns all cells in their order, each with the number of those before it that have the same values.

    Args:
        cells: The cells.
        seed: The seed on which drawn points depend.
    """
    return [(cells.cell(place, seed), cells.repeats(place, seed)) for place in range(cells.count)]


def job_of_cell(request: Mapping[str, Any], cell: StepCell, number: int) -> dict[str, Any]:
    """Returns a cell's job request with the seed of one job, and with the cell's values added to its tags.

    A cell is one combination of the axes' values. Its jobs differ in their seeds only, and all cells have the same
    seeds, unless a design has a cell again: its jobs are numbered on. A job with trials takes as many seeds as these
    need, so the next job's seed comes after them.

    Args:
        request: Request of the cell: what the specification has under `value`, with the cell's values filled in.
        cell: Value of each axis, by the axis's name.
        number: Number of the job in its cell, from 0.
    """
    given = request.get("seed", 0)
    if not isinstance(given, int) or not 0 <= given <= MAX_SEED:
        number = 0  # the request is refused for its seed
    tags = request.get("tags")
    own = dict(tags) if is_mapping(tags) else {}
    said = {f"{AXIS_TAG}{name}": tag_value(value) for name, value in cell.items()}
    seed = (given + number * trials_seeds(request)) % (MAX_SEED + 1) if number else given
    return {**request, "seed": seed, "tags": {**own, **said}}


def clashing_axes(names: Sequence[str] | Mapping[str, Any], request: Mapping[str, Any]) -> list[str]:
    """Returns the axes of a step that trials of its jobs have too: a row could not say both."""
    trials = request.get("trials")
    of_trials = trials.get(AXES) if is_mapping(trials) else None
    return [name for name in names if is_mapping(of_trials) and name in of_trials]


def clashing_words(name: str) -> str:
    """Makes the error text for an axis of trials that has the name of one of the step's axes."""
    return f"the step has an axis {name!r} too, and a row of results can say but one of both; rename one"


def points_seed(written: object) -> int:
    """Returns the seed on which drawn points depend: that of `value` if it is written there, else 0."""
    return written if isinstance(written, int) and not isinstance(written, bool) else 0


def is_axes_location(location: Location) -> bool:
    """Whether a list of an input may be made by axes: the requests of a batch."""
    return location == ("createSimulationJobRequests",)
