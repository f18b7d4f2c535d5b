"""Pages of runs that were ordered in the console, cancelling and resuming them, and running failed jobs again."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from starlette.responses import RedirectResponse, Response

from ....schemas.lifecycles import is_terminal
from ....schemas.specs.check import load_spec
from ....schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from ....tasks.inspection.reruns import Selection, failed_again, plan_rerun
from ...endpoint.protocol_errors import AccessDeniedException
from ...spec_runs.rights import problems_of_rights
from ...spec_runs.spec_runs import Standing, StepStanding
from .. import runs
from ..batches import batches_of_run
from ..job_states import RUNNING, WAITING, Look
from ..rendering import HOME, address, render
from ..runs import find_record
from ..streams import Parts
from ..visit import Visit
from .run_starts import START, begin, runs_of

_RUN_ID = re.compile(r"[a-zA-Z0-9][a-zA-Z0-9_\-]{0,99}-\d{8}T\d{9}")
_EVERY_S = 1.0


@dataclass(frozen=True)
class StepLine:
    """A step of a run, as its web page shows it."""

    step: StepStanding
    look: Look

    @property
    def resource(self) -> tuple[str, str]:
        """Kind and id of the resource that the step created; empty if there is none."""
        kind, _, name = self.step.detail.rpartition(":")[2].partition("/")
        return (kind, name) if self.step.detail.startswith("arn:") else ("", "")


def standing_of(run_id: str, visit: Visit) -> Standing | None:
    """Returns the state of a run ordered in the console; `None` if there is none that the visitor may see."""
    ordered = visit.context.spec_runs
    if ordered is None or not _RUN_ID.fullmatch(run_id) or (standing := ordered.standing(run_id)) is None:
        return None
    is_own = visit.key is not None and visit.key.id == standing.key_id
    return standing if visit.sees_all or is_own else None


def show_all(visit: Visit) -> Response:
    """Web page with the list of runs, current ones included."""
    ordered = visit.context.spec_runs
    found = {run_id: standing_of(run_id, visit) for run_id in (ordered.going() if ordered else ())}
    return runs.show_all(visit, {run_id: standing for run_id, standing in found.items() if standing is not None})


def show(visit: Visit) -> Response:
    """Web page of a run, current or ended."""
    run_id = visit.request.path_params["id"]
    standing = None if runs.is_known(run_id, visit) else standing_of(run_id, visit)
    if standing is None:
        return runs.show(visit)
    return visit.page("run_going.html.j2", **_values(visit, run_id, standing))


def follow(visit: Visit) -> Response:
    """Streams changes of a run's web page to the browser, which reloads the page when the run has ended."""
    run_id = visit.request.path_params["id"]
    _found(visit, run_id)
    parts = Parts()

    def look() -> Iterator[tuple[str, Any]]:
        values = _values(visit, run_id, _found(visit, run_id))
        steps = render("run_going_steps.html.j2", visit=visit, **values)
        batches = render("run_going_batches.html.j2", visit=visit, **values)
        yield from parts.news({"going": steps, "run-batches": batches})
        if not values["is_going"]:
            yield "reload", None
            yield "end", None

    return visit.follow(look, _EVERY_S)


def cancel(visit: Visit) -> Response:
    """Handles the web console's button that cancels a run.

    Raises:
        ResourceNotFoundException: The run does not exist, or is not the visitor's.
        AccessDeniedException: The visitor's key is not good for ending runs.
    """
    run_id = visit.request.path_params["id"]
    with visit.noted("CancelRun", *filter(_RUN_ID.fullmatch, [run_id])):
        _found(visit, run_id)
        if not visit.may("CancelSimulationJobBatch"):
            raise AccessDeniedException("to cancel a run needs an access key with robomaker_scope = submit")
        assert visit.context.spec_runs is not None
        visit.context.spec_runs.cancel(run_id)
    return RedirectResponse(f"{HOME}/runs/{run_id}", 303)


def take_up(visit: Visit) -> Response:
    """Handles the web console's button that resumes an interrupted run.

    Raises:
        ResourceNotFoundException: The run does not exist, or is not the visitor's.
        AccessDeniedException: The visitor's key is not good for runs.
        InvalidParameterException: The run was not interrupted.
        ThrottlingException: Too many run already.
    """
    run_id = visit.request.path_params["id"]
    with visit.noted("TakeUpRun", *filter(_RUN_ID.fullmatch, [run_id])):
        _found(visit, run_id)
        if not visit.may_order_runs:
            raise AccessDeniedException("to have a run go on needs an access key with robomaker_scope = submit")
        assert visit.context.spec_runs is not None
        if not visit.context.spec_runs.take_up(run_id):
            raise InvalidParameterException(f"{run_id} has ended, or goes on already")
    return RedirectResponse(f"{HOME}/runs/{run_id}", 303)


def _found(visit: Visit, run_id: str) -> Standing:
    standing = standing_of(run_id, visit)
    if standing is None:
        raise ResourceNotFoundException(f"no run {run_id} was ordered here")
    return standing


def _values(visit: Visit, run_id: str, standing: Standing) -> dict[str, Any]:
    ordered = visit.context.spec_runs
    assert ordered is not None
    is_going = ordered.is_going(run_id)
    is_broken = standing.problem or any(step.status in ("waiting", "running") for step in standing.steps)
    return {
        "run_id": run_id,
        "standing": standing,
        "is_going": is_going,
        "has_broken_off": not is_going and ordered.has_broken_off(run_id),
        "steps": [StepLine(step, _look(step, is_going=is_going)) for step in standing.steps],
        "last_words": ordered.last_words(run_id) if visit.sees_all and is_broken and not is_going else "",
        "batches": batches_of_run(run_id, visit),
    }


def _look(step: StepStanding, *, is_going: bool) -> Look:
    if step.status == "waiting":
        return WAITING if is_going else Look("canceled", "never begun")
    if step.status == "running":
        return RUNNING if is_going else Look("broken", "broke off")
    if step.status in ("Completed", "Succeeded"):
        return Look("passed", step.status)
    return Look("canceled" if step.status in ("Canceled", "Skipped", "TimedOut") else "broken", step.status)


_BATCH = "simulation-job-batch"
_START_BATCH = "StartSimulationJobBatch"
_NOTHING = "nothing to run again: each job has a good result"


def failed_of_run(visit: Visit) -> Response:
    """Handles the button that runs a run's failed jobs again.

    Raises:
        ResourceNotFoundException: The visitor may see no such run.
        AccessDeniedException: The visitor's key is not good for it.
        InvalidParameterException: No job of the run failed.
    """
    with visit.noted(START) as call:
        ordered = runs_of(visit)
        record = find_record(visit)
        call.resources = [record.run_id]
        rerun = plan_rerun(record, Selection(failed=True), visit.service)
        if rerun is None:
            raise InvalidParameterException(_NOTHING)
        spec = load_spec(rerun.spec_text, f"rerun of {record.run_id}")
        if refused := problems_of_rights(visit.key, spec, visit.service.catalog):
            raise AccessDeniedException(refused[0].message)
        return begin(visit, ordered, spec, call, spec_path=record.spec_path, rerun_of=rerun.rerun_of)


def failed_of_batch(visit: Visit) -> Response:
    """Handles the button that runs a batch's failed jobs again.

    Raises:
        ResourceNotFoundException: The visitor may see no such batch.
        AccessDeniedException: The visitor's key is not good for it.
        InvalidParameterException: The batch has not ended, or none of its jobs failed.
    """
    with visit.noted(_START_BATCH, if_refused=True) as call:
        batch = visit.find(_BATCH, visit.request.path_params["id"])
        call.resources = [batch.arn]
        if not is_terminal(_BATCH, batch.status):
            raise InvalidParameterException(f"the batch is {batch.status}; what failed is run again once it has ended")
        request = failed_again(batch.arn, visit.service)
        if request is None:
            raise InvalidParameterException(_NOTHING)
    made = visit.call(_START_BATCH, request)
    return RedirectResponse(address(_BATCH, made["arn"].rpartition("/")[2]), 303)
