"""Starts runs from the console: of a specification of the package, or one that is pasted or uploaded."""

import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import PurePath

from starlette.responses import RedirectResponse, Response

from ....schemas.reports.run_record import Order, RerunOf, new_run_id
from ....schemas.specs.check import declared_parameters
from ....schemas.specs.parameter_values import set_options, value_in_words
from ....schemas.specs.parameters import AsText, Parameter
from ....schemas.specs.specification import CheckedSpec
from ....schemas.wire.errors import InvalidParameterException, Problem, SpecError, ThrottlingException
from ....tasks.inspection.preflight import check_preconditions
from ....tasks.service.world_names import with_worlds_found
from ...endpoint.calling.audit_log import Call
from ...endpoint.calling.scopes import check_scope
from ...endpoint.protocol_errors import AccessDeniedException
from ...spec_runs.rights import problems_of_rights
from ...spec_runs.spec_runs import SpecRuns, Standing, StepStanding
from ...spec_runs.visitor_specifications import checked, shipped_specs
from ..rendering import HOME
from ..visit import Visit

START = "StartRun"
"""Name of a run's order in the audit log; the log names steps by their operations."""

_NEEDED = "StartSimulationJobBatch"
"""Operation that an access key has to permit for ordering runs."""

_FIELD = "parameter."
"""Prefix of the names of form fields with the values of the specification's parameters."""

_AROUND = 2
"""Number of lines that are shown before and after a specification's line with a problem."""

_MOST_PROBLEMS = 50
_PATIENCE_S = 10.0
_checks = threading.BoundedSemaphore(1)
"""Lock for checking specifications one at a time, as long texts take seconds of processor time."""


@dataclass(frozen=True)
class ShownProblem:
    """A problem of a specification, with the lines around it for display."""

    line: int
    column: int
    path: str
    message: str
    lines: list[tuple[int, str]]
    parameter: str = ""
    """Name of the parameter whose value is refused, or missing; empty: the text has the problem."""


@dataclass(frozen=True)
class Draft:
    """A specification that a visitor is writing in the web console, with its problems."""

    text: str
    filename: str
    shipped: str = ""
    """Name of the package's specification that the draft equals; empty: none."""

    values: Mapping[str, str] = field(default_factory=dict[str, str])
    """Values of its parameters as text; parameters that are left empty have their defaults."""

    declared: Mapping[str, Parameter] = field(default_factory=dict[str, Parameter])
    """Parameters that a visitor's specification declares; empty if it cannot be read."""

    spec: CheckedSpec | None = None
    problems: list[ShownProblem] = field(default_factory=list)
    more_problems: int = 0
    is_refused: bool = False
    """Whether a draft's only problems are missing rights of the visitor's key."""

    @property
    def refused(self) -> dict[str, str]:
        """Refused values of parameters: what is wrong with each, by name of the parameter."""
        return {problem.parameter: problem.message for problem in self.problems if problem.parameter}

    @property
    def allowed(self) -> dict[str, str]:
        """Allowed values of parameters in words, by name, of those that have neither choices nor any value."""
        return {name: words for name, parameter in self.declared.items() if (words := _allowed(parameter))}


def show(visit: Visit) -> Response:
    """Web page for ordering a run, with the shipped specification that the address names, or with an empty one.

    Raises an error if the visitor may not order runs here.
    """
    runs_of(visit)
    name = visit.parameter("spec")
    text = shipped_specs().get(name, "")
    return _page(visit, _checked(visit, Draft(text, f"{name}.yaml", name), starts=False) if text else Draft("", ""))


def check(visit: Visit) -> Response:
    """Checks a specification while it is being written; returns the HTML list of problems."""
    runs_of(visit)
    return visit.page("spec_findings.html.j2", draft=_checked(visit, _draft(visit), starts=False))


def take(visit: Visit) -> Response:
    """Handles the order form: checks the specification, and starts the run if the visitor asks for it and all is valid.

    Each attempt to start is written to the audit log. The form comes again, with its problems, if no run was started.
    """
    if visit.form.get("do") != "start":
        runs_of(visit)
        return _answer(visit, _checked(visit, _draft(visit), starts=False))
    with visit.noted(START) as call:
        runs = runs_of(visit)
        draft = _checked(visit, _draft(visit), starts=True)
        if draft.spec is not None:
            return begin(visit, runs, draft.spec, call, spec_path=draft.shipped)
        call.outcome = (AccessDeniedException if draft.is_refused else InvalidParameterException).__name__
    return _answer(visit, draft)


def begin(
    visit: Visit, runs: SpecRuns, spec: CheckedSpec, call: Call, *, spec_path: str, rerun_of: RerunOf | None = None
) -> Response:
    """Starts a run for a visitor of the web console, and redirects to its page.

    Args:
        visit: The visitor's request; the run's steps use the visitor's access key.
        runs: The server's runs.
        spec: The specification.
        call: Gets the run's id, for the audit log.
        spec_path: File name in the run's record; empty: that of the file in the run's folder.
        rerun_of: The run that it repeats; `None`: it is no rerun.

    Raises:
        ThrottlingException: Too many run already.
    """
    run_id = new_run_id(spec.name, visit.service.clock())
    path = spec_path or str(visit.service.settings.home / "runs" / run_id / "spec.yaml")
    again = ["robomaker", "run", path, *set_options(spec.parameters)]
    command = ["robomaker", "rerun", rerun_of.run_id, "--failed"] if rerun_of else again
    key = visit.key
    order = Order(
        run_id=run_id,
        text=spec.text,
        filename=spec.filename,
        spec_path=path,
        command=command,
        parameters=dict(spec.parameters),
        worlds=dict(spec.found_worlds),
        rerun_of=rerun_of,
        key_id=key and key.id,
        address=visit.address,
        audit_log=runs.audit_log,
    )
    steps = [StepStanding(name=name, operation=spec.steps[name].operation) for name in spec.order]
    ordered_by = (key.name or key.id) if key else ""
    runs.begin(order, Standing(name=spec.name, key_id=order.key_id, ordered_by=ordered_by, steps=steps))
    call.resources = [run_id, *call.resources]
    return RedirectResponse(f"{HOME}/runs/{run_id}", 303)


def runs_of(visit: Visit) -> SpecRuns:
    """Returns the server's runs, after checking that the visitor may order runs.

    Raises:
        AccessDeniedException: The visitor's key is not good for ordering any.
        InvalidParameterException: This server does not execute runs.
    """
    if visit.key is not None:
        check_scope(visit.key, _NEEDED)
    if visit.context.spec_runs is None:
        raise InvalidParameterException("this server performs no jobs (--execute none), so it begins no runs either")
    return visit.context.spec_runs


def _draft(visit: Visit) -> Draft:
    form = visit.form
    text, filename = form.get("file", ""), PurePath(form.get("file.name", "")).name
    if not text:
        text, filename = form.get("text", ""), form.get("filename", "")
    text = text.replace("\r\n", "\n")  # as browsers send lines
    shipped = next((name for name, known in shipped_specs().items() if known.strip() == text.strip()), "")
    plain = re.sub(r"[^\w.\- ]", "_", filename)[:100]
    values = {name.removeprefix(_FIELD): value for name, value in form.items() if name.startswith(_FIELD) and value}
    return Draft(text, f"{shipped}.yaml" if shipped else plain or "specification.yaml", shipped, values)


def _checked(visit: Visit, draft: Draft, *, starts: bool) -> Draft:
    """Returns the draft of an order with its problems, or with its plan.

    A run that starts must have values for all parameters; a check alone may lack some. Values of parameters that the
    specification no longer declares are ignored.
    """
    with _one_at_a_time():
        declared = declared_parameters(draft.text)
        # What was filled in for a parameter that is not there any more is kept for its return.
        given = {name: AsText(value) for name, value in draft.values.items() if name in declared}
        draft = replace(draft, declared=declared)
        try:
            spec = checked(draft.text, draft.filename, given, is_complete=starts)
            if spec.missing:
                return replace(draft, spec=spec)
            if refused := problems_of_rights(visit.key, spec, visit.service.catalog):
                return _with_problems(draft, refused, is_refused=True)
            spec = with_worlds_found(spec, visit.service)
            check_preconditions(spec, visit.service)
        except SpecError as error:
            return _with_problems(draft, list(error.problems))
    return replace(draft, spec=spec)


def _with_problems(draft: Draft, problems: list[Problem], *, is_refused: bool = False) -> Draft:
    lines = draft.text.split("\n")
    given = {f"parameters.{name}": name for name in draft.declared}
    shown = [_shown(problem, lines, given) for problem in problems[:_MOST_PROBLEMS]]
    more = len(problems) - len(shown)
    return replace(draft, problems=shown, more_problems=more, is_refused=is_refused)


def _shown(problem: Problem, lines: list[str], given: Mapping[str, str]) -> ShownProblem:
    place = problem.place
    first, last = max(1, place.line - _AROUND), min(len(lines), place.line + _AROUND)
    around = [(number, lines[number - 1]) for number in range(first, last + 1)]
    return ShownProblem(place.line, place.column, problem.path, problem.message, around, given.get(problem.path, ""))


def _allowed(parameter: Parameter) -> str:
    """Returns the allowed values of a parameter in words: `a whole number from 1 to 50`; empty: any, or choices."""
    if parameter.choices:
        return ""
    noun = {"integer": "a whole number", "number": "a number"}.get(parameter.value_type, "")
    low, high = parameter.minimum, parameter.maximum
    if low is not None and high is not None:
        return f"{noun} from {value_in_words(low)} to {value_in_words(high)}"
    if low is not None:
        return f"{noun}, at least {value_in_words(low)}"
    if high is not None:
        return f"{noun}, at most {value_in_words(high)}"
    return f"a text that matches {parameter.pattern}" if parameter.pattern else noun


def _answer(visit: Visit, draft: Draft) -> Response:
    return _page(visit, draft, 403 if draft.is_refused else 400 if draft.problems else 200)


def _page(visit: Visit, draft: Draft, status: int = 200) -> Response:
    return visit.page("run_new.html.j2", status=status, draft=draft, shipped=list(shipped_specs()))


@contextmanager
def _one_at_a_time() -> Iterator[None]:
    if not _checks.acquire(timeout=_PATIENCE_S):
        raise ThrottlingException("other specifications are being checked; try again in a moment")
    try:
        yield
    finally:
        _checks.release()
