"""Stores the order of a run, resumes an interrupted run from its order, and makes its specification from it again."""

from dataclasses import replace

from ...schemas.reports.progress import Note, ProgressListener
from ...schemas.reports.run_record import Order
from ...schemas.settings import Settings
from ...schemas.specs.check import load_spec
from ...schemas.specs.specification import CheckedSpec, with_seed
from ..execution.dead_flow_runs import tell_of_dead
from ..inspection.pipeline_parts import Permit
from ..service.service import Service
from ..service.world_names import with_known_worlds
from .broken_off import BrokenOff, broken_off
from .ending import Outlasting, RunFacts, is_pinged
from .environments import environment_of_run
from .missed_nights import note_schedule
from .open_runs import OpenRun
from .pings import ping_start
from .wanted_runs import WantedRun


def keep_order(
    facts: RunFacts,
    service: Service,
    open_run: OpenRun | None,
    *,
    flow_run: str | None,
    deployment: str | None,
    outlasting: Outlasting,
    listener: ProgressListener,
) -> OpenRun | None:
    """Stores everything another process needs to finish a run if this one dies.

    Args:
        facts: Facts of the run that are known when it begins.
        service: The service, with its catalog and object store.
        open_run: The run, if its order is kept already.
        flow_run: Id of its flow run.
        deployment: Id of the Prefect deployment that this is a run of.
        outlasting: Waits for the catalog.
        listener: Called with problems.

    Returns:
        The run; `None`: its order cannot be kept, and it goes on without.
    """
    known = {
        "flow_run": flow_run and str(flow_run),
        "started_at": facts.started_at,
        "source": facts.source,
        "worlds": dict(facts.wanted.checked.found_worlds),
    }
    deployment = deployment and str(deployment)
    if deployment is not None:
        note_schedule(service.settings.home, deployment, facts.wanted.checked.name, service.clock())
    if is_pinged(facts) and not (open_run is not None and open_run.order.interruptions):
        ping_start(service.settings.ping_url, facts.wanted.checked.name, facts.run_id)
    try:
        if open_run is not None:
            order = open_run.order
            if order.interruptions and order.flow_run:
                name = f"{facts.run_id}, continued"
                if tell_of_dead(order.flow_run, f"its process died; the flow run {name}, finishes it"):
                    open_run.cancel()
            open_run.change(**known, deployment=deployment or order.deployment)
            open_run.live()
            return open_run
        checked = facts.wanted.checked
        order = Order(
            run_id=facts.run_id,
            text=checked.text,
            filename=checked.filename,
            name=checked.name,
            seed=checked.seed,
            parameters=dict(checked.parameters),
            spec_path=facts.wanted.spec_path,
            command=facts.wanted.repeated_by,
            rerun_of=facts.wanted.rerun_of,
            reuse=service.reuses,
            needed=outlasting(lambda: environment_of_run(checked, service)),
            deployment=deployment,
            against=facts.wanted.against,
        )
        begun = OpenRun.begin(facts.folder, order.model_copy(update=known))
        begun.live()
        return begun
    except OSError as error:
        listener(Note(f"no other process could finish this run, since its order cannot be kept: {error}"))
        return open_run


def ordered_run(run: OpenRun, permit: Permit | None = None) -> WantedRun:
    """Returns a run as its stored order wants it.

    Args:
        run: The run.
        permit: Allows or refuses each request; `None`: all are allowed.

    Raises:
        SpecError: This release finds problems in its specification.
    """
    order = run.order
    return WantedRun(
        ordered_spec(order), order.spec_path, order.command, reuse=order.reuse, rerun_of=order.rerun_of,
        against=order.against, open_run=run, permit=permit,
    )  # fmt: skip


def ordered_spec(order: Order) -> CheckedSpec:
    """Returns the checked specification of a stored order, with the worlds that were found when the run began.

    Raises:
        SpecError: This release finds problems in it.
    """
    spec = load_spec(order.text, order.filename, order.parameters)
    if order.name is not None:
        spec = replace(spec, name=order.name)
    if order.seed is not None:
        spec = with_seed(spec, order.seed)
    return with_known_worlds(spec, order.worlds)


def taken_run(settings: Settings, run_id: str) -> OpenRun | str:
    """Takes over an interrupted run, so that this process finishes it; or returns why it cannot.

    Args:
        settings: Settings of this process.
        run_id: The run's id.

    Returns:
        The run, or why it is left.
    """
    folder = settings.home / "runs" / run_id
    found = broken_off(folder, settings) if folder.name == run_id else None
    if found is not None and found.why_left:
        tell_of_left(found)
        return _left_in_words(found)
    claimed = OpenRun.claim(folder) if found is not None else None
    return claimed or f"skipped: no run {run_id} here has broken off; it has ended, or another process carries it out"


def _left_in_words(run: BrokenOff) -> str:
    """Describes what resumes a run that processes like this one do not resume.

    It reads `its process died, and REASON; this finishes it: on vm: COMMAND`.
    """
    return f"its process died, and {run.why_left}; this finishes it: {run.place}{run.command}"


def tell_of_left(run: BrokenOff) -> None:
    """Writes into a dead flow run's state in Prefect how its run is resumed."""
    if run.order.flow_run is not None:
        tell_of_dead(run.order.flow_run, _left_in_words(run))
