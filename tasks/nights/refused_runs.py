"""Runs that are refused before their first step: each leaves a record with the reason, and is told of like any other.

A run that a schedule has begun is not watched: its error alone would be seen in Prefect only.
"""

import logging
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...schemas.reports.progress import ProgressListener
from ...schemas.reports.run_record import BEFORE_STEPS, Order, RunRecord, StepRecord, new_run_id
from ...schemas.settings import Settings
from ...schemas.specs.check import load_spec
from ...schemas.specs.specification import CheckedSpec, is_spec_name
from ...schemas.wire.errors import RobomakerError
from ..inspection.pipeline_parts import refusal_in_words
from ..inspection.run_records import commit_of
from ..service.service import Service
from .ending import RunFacts, finish_run, is_pinged
from .missed_nights import note_schedule
from .pings import ping_start
from .wanted_runs import WantedRun

_logger = logging.getLogger(__name__)


def known_spec(text: str | None, origin: str, parameters: Mapping[str, Any] | None, name: str | None) -> CheckedSpec:
    """Returns the specification of a refused run, as far as it can be read.

    Args:
        text: Text of the specification; `None`: it could not be read.
        origin: Name of the file.
        parameters: Values that the run was given.
        name: Name of the run's deployment; `None`: it has none.

    Returns:
        The specification; one that has problems has no steps, and the name of the deployment or of the file.
    """
    if text is not None:
        with suppress(RobomakerError):
            return load_spec(text, origin, parameters)
        with suppress(RobomakerError):
            known = load_spec(text, origin, is_complete=False)
            given = {name: value for name, value in (parameters or {}).items() if name in known.declared}
            return replace(known, parameters={**known.parameters, **given})
    names = filter(is_spec_name, (name or "", Path(origin).stem))
    # Without the text: secrets cannot be found in one that has problems.
    return CheckedSpec(next(names, "specification"), "", origin, "", steps={}, order=())


def finish_refused(
    wanted: WantedRun,
    error: Exception,
    settings: Settings,
    listener: ProgressListener,
    *,
    flow_run: str | None = None,
    deployment: str | None = None,
    run_id: str | None = None,
) -> RunRecord | None:
    """Writes the record and report of a run that was refused before its first step, and sends notifications.

    Args:
        wanted: The run, with its specification as far as it is known.
        error: Reason for which it was refused.
        settings: Settings that say who is notified and called.
        listener: Called with problems.
        flow_run: Id of the flow run that refused it; `None`: it had none yet.
        deployment: Id of the Prefect deployment that this is a run of; `None`: of none.
        run_id: Id of the run, whose folder may be there; `None`: it has none yet.

    Returns:
        The record; `None`: it could not be written, which is logged.
    """
    spec, at = wanted.checked, datetime.now(UTC)
    run_id, reason = run_id or new_run_id(spec.name, at), refusal_in_words(error)
    folder = settings.home / "runs" / run_id
    facts = RunFacts(wanted, run_id, at, commit_of(Path(wanted.spec_path)), folder)
    if is_pinged(facts) and (begun := ping_start(settings.ping_url, spec.name, run_id)) is not None:
        begun.join()  # else the call of the end could come before it
    refused = StepRecord(name=BEFORE_STEPS, operation="RunPipeline", status="Failed", error=reason)
    skipped = [StepRecord(name=name, operation=spec.steps[name].operation, status="Skipped") for name in spec.order]
    try:
        if deployment is not None and spec.order:  # else its name is not known
            note_schedule(settings.home, str(deployment), spec.name, at)
        folder.mkdir(parents=True, exist_ok=True)
        return finish_run(
            facts,
            [refused, *skipped],
            settings,
            _service(),
            listener,
            ended_at=at,
            is_canceled=False,
            against=None,
            interruptions=(),
            flow_run=flow_run,
            outlasting=lambda call: call(),
        )
    except Exception:  # the reason for the refusal is raised, and counts more
        _logger.exception("the refused run %s has no record", run_id)
        return None


def finish_refused_order(order: Order, error: Exception, settings: Settings, listener: ProgressListener) -> None:
    """Does for a run that was ordered in the console, and refused, what `finish_refused` does for those of deployments.

    Args:
        order: The order, whose specification may have problems.
        error: Reason for which it was refused.
        settings: Settings that say who is notified and called.
        listener: Called with problems.
    """
    known = known_spec(order.text, order.filename, order.parameters, order.name)
    spec = replace(known, name=order.name or known.name)
    wanted = WantedRun(spec, order.spec_path, order.command, reuse=order.reuse, rerun_of=order.rerun_of)
    finish_refused(wanted, error, settings, listener, run_id=order.run_id)


def _service() -> Service | None:
    """Returns the service; `None` if it cannot be opened, which may be why the run is refused."""
    try:
        return Service.current()
    except Exception as error:
        _logger.warning("a refused run has no report: %s: %s", type(error).__name__, error)
        return None
