"""How flow runs came to their end, by what their processes wrote down: the records of runs, and the catalog.

A server that was away was not told of all ends. It takes silence for death; this is asked before it does, and after.
"""

import logging
import time
from contextlib import suppress
from datetime import datetime
from typing import Any
from uuid import UUID

from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.filters import FlowRunFilter, FlowRunFilterName
from prefect.client.schemas.objects import FlowRun, State

from ..schemas.lifecycles import is_terminal
from ..schemas.reports.run_states import result_of
from ..schemas.settings import Settings
from ..schemas.wire.errors import RobomakerError
from ..tasks.execution.dead_flow_runs import was_silent
from ..tasks.execution.flow_ends import end_state
from ..tasks.inspection.run_records import RECORD_NAME, read_record
from ..tasks.inspection.standings import job_result
from ..tasks.operations.registry import registry
from ..tasks.service.service import Service

_FRESH_S = 60.0

_logger = logging.getLogger(__name__)


class RecordedEnds:
    """Ends of flow runs as one data home has recorded them; used from one thread.

    Args:
        settings: the data home's.
        client: of the server that shows the flow runs.
    """

    def __init__(self, settings: Settings, client: SyncPrefectClient) -> None:
        self._settings = settings
        self._client = client
        self._answers: dict[UUID, tuple[float, State[Any] | None]] = {}

    def end_of(self, run: FlowRun) -> State[Any] | None:
        """Says how a flow run ended; `None`: it is not known here. Answers are up to a minute old."""
        now_s = time.monotonic()
        self._answers = {each: (at_s, end) for each, (at_s, end) in self._answers.items() if now_s - at_s < _FRESH_S}
        if run.id not in self._answers:
            self._answers[run.id] = now_s, self._find_end(run)
        return self._answers[run.id][1]

    def _find_end(self, run: FlowRun) -> State[Any] | None:
        try:
            arn = run.parameters.get("arn")
            return self._end_of_run(run) if arn is None else self._end_of_job(run, str(arn))
        except (RobomakerError, OSError) as error:
            _logger.debug("how %s ended is not known: %s", run.name, error)
            return None

    def _end_of_run(self, run: FlowRun) -> State[Any] | None:
        """The end of a run of a specification: only the flow run that wrote the record has ended so."""
        began = run.start_time or run.created
        for path in (self._settings.home / "runs").glob(f"*/{RECORD_NAME}"):
            with suppress(OSError):
                if began is not None and datetime.fromtimestamp(path.stat().st_mtime, began.tzinfo) < began:
                    continue
                if str(run.id).encode() not in path.read_bytes():  # most are of others, and some are large
                    continue
            record = read_record(path)
            if record.flow_run == run.id:
                return end_state(result_of(record), None, verdict_fails_run=self._settings.verdict_fails_run)
        return None

    def _end_of_job(self, run: FlowRun, arn: str) -> State[Any] | None:
        """The end of a job, if a flow run that was called dead is the last that carried it out."""
        if not was_silent(run):
            return None  # somebody saw that it died
        with Service.opened(self._settings) as service:
            job = service.catalog.get_many([arn]).get(arn)
            if job is None or not is_terminal(job.kind, job.status) or not self._is_last(run):
                return None
            flow = self._client.read_flow(run.flow_id).name
            operation = next(each for each in registry().values() if each.run_job and each.perform_name == flow)
            result = job_result(operation.name, operation.described(arn, service), service)
            return end_state(result, None, verdict_fails_run=self._settings.verdict_fails_run)

    def _is_last(self, run: FlowRun) -> bool:
        """Whether no later flow run carried out the same job: its end would be that one's."""
        named = FlowRunFilter(name=FlowRunFilterName(any_=[run.name]))
        began = run.start_time or run.created
        return all(
            each.id == run.id or began is None or (each.start_time or each.created or began) < began
            for each in self._client.read_flow_runs(flow_run_filter=named)
        )
