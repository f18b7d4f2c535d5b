"""Running again what failed: of a run, as `robomaker rerun --failed` does, and of a batch."""

from starlette.responses import RedirectResponse, Response

from ....schemas.lifecycles import is_terminal
from ....schemas.specs.check import load_spec
from ....schemas.wire.errors import InvalidParameterException
from ....tasks.inspection.reruns import Selection, failed_again, plan_rerun
from ...endpoint.messages import AccessDeniedException
from ...spec_runs.rights import problems_of_rights
from ..rendering import address
from ..runs import find_record
from ..visit import Visit
from .start import START, begin, runs_of

_BATCH = "simulation-job-batch"
_START_BATCH = "StartSimulationJobBatch"
_NOTHING = "nothing to run again: each job has a good result"


def failed_of_run(visit: Visit) -> Response:
    """Begins a rerun of the failed jobs of a run, and shows it.

    Raises:
        ResourceNotFoundException: there is no such run that the visitor may see.
        AccessDeniedException: the visitor's key is not good for it.
        InvalidParameterException: nothing failed.
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
    """Starts a batch of the failed jobs of a batch, and shows it.

    Raises:
        ResourceNotFoundException: there is no such batch that the visitor may see.
        AccessDeniedException: the visitor's key is not good for it.
        InvalidParameterException: it has not ended, or nothing failed.
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
