"""Runs a specification for `run` and `rerun`: progress display, report, summary, exit code."""

import argparse
import os
import shlex
import shutil
import sys
from collections.abc import Sequence
from contextlib import ExitStack, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ...schemas.reports.live_comparison import Against
from ...schemas.reports.progress import Note, ProgressListener
from ...schemas.reports.run_record import RunRecord
from ...schemas.settings import Settings
from ...schemas.specs.specification import CheckedSpec
from .output.answers import open_file, opens_files
from .signals import interrupted_by_signals

if TYPE_CHECKING:
    from ...tasks.nights.wanted_runs import WantedRun


def carry_out(
    wanted: "WantedRun", settings: Settings, arguments: argparse.Namespace, *, report: Path | None = None
) -> int:
    """Runs a specification, shows its progress, prints the results, and returns the exit code.

    Args:
        wanted: The specification, and everything that is asked of the run besides.
        settings: Settings of the run.
        arguments: Parsed command line: `output` and `open`.
        report: Path of a copy of the report; None: no copy.

    Returns:
        The exit code, which says how the run ended.
    """
    from .output.progress import watcher
    from .prefect_server import tell_after_outage, use_server, wait_for_server_once

    # A server that somebody else keeps is asked first: without it nothing is made here, not even the home.
    api_url = use_server(settings, for_runs=True) if os.environ.get("PREFECT_API_URL") else None
    spec, is_new = wanted.checked, not (wanted.reuse or wanted.rerun_of or wanted.open_run)
    # A run that another process began is finished also where the earlier one is gone; it tells of that itself.
    against = None if wanted.open_run else wanted.against
    check_before_start(spec, settings, checks_templates=is_new, against=against)
    api_url = api_url or use_server(settings, for_runs=True)
    steps = [(name, spec.steps[name].operation) for name in spec.order]
    with interrupted_by_signals(), watcher(steps, os.environ) as listener:
        outage = wait_for_server_once(api_url, settings, lambda text: listener(Note(text)))
        from ...tasks.inspection.pipeline_parts import RunInterrupted
        from ...tasks.nights.cut_runs import removing_made
        from ...tasks.service.service import Service

        with ExitStack() as stack:
            heard = listener
            if wanted.is_probe:
                heard = stack.enter_context(removing_made(stack.enter_context(Service.opened(settings)), listener))
            try:
                record = run_beside_others(wanted, settings, heard)
            except RunInterrupted as interruption:
                interrupted, record = interruption, interruption.record
            except KeyboardInterrupt:  # once more, while the report was written, or before there was anything to tell
                if wanted.is_probe:  # of other runs the next one, or `perform`, writes it
                    again = shlex.join(wanted.repeated_by)
                    listener(
                        Note(f"there is no report, as the run was interrupted before it was written; again: {again}")
                    )
                raise
            else:
                interrupted = None
        tell_after_outage(outage, settings)
    record = _with_report(record, report)
    with suppress(OSError) if interrupted else nullcontext():  # the terminal that hung up is gone
        asked = None if outage.is_on else api_url
        _tell(record, wanted.repeated_by, asked, settings, as_json=arguments.output == "json")
    if interrupted and record.state != "succeeded":  # else it came too late to stop anything
        raise interrupted
    if record.report_path and opens_files(arguments.open):
        open_file(record.report_path)
    return record.exit_code


def check_before_start(
    spec: CheckedSpec, settings: Settings, *, checks_templates: bool, against: Against | None = None
) -> None:
    """Raises errors for a run that cannot start, before a server is started and Prefect is imported.

    Args:
        spec: The specification.
        settings: Settings of the run.
        checks_templates: Whether the templates that it names are checked, too.
        against: The earlier run that it is compared with; `None`: none.

    Raises:
        RobomakerError: The run cannot start; the message says why.
    """
    from ...tasks.inspection.preflight import check_named, check_templates
    from ...tasks.service.service import Service

    with Service.opened(settings) as service:
        check_named(spec, service)
        if against is not None:
            from ...tasks.inspection.runs_beside import earlier_run

            earlier_run(against, settings.home / "runs", spec)
        if checks_templates:
            check_templates(spec, service)


def run_beside_others(wanted: "WantedRun", settings: Settings, listener: ProgressListener) -> RunRecord:
    """Runs a specification and returns its record; meanwhile runs that broke off are resumed in the background.

    Before it begins, runs in Prefect whose processes died are closed. Errors are those of `run_spec`.
    """
    from ...flows.pipelines import run_spec
    from ...tasks.nights.run_orders import tell_of_left
    from ...tasks.nights.taking_up import TakingUp
    from ..dead_run_sweeper import close_dead_runs_once
    from ..missed_nights import look_for_missed_nights

    close_dead_runs_once(settings)
    look_for_missed = partial(look_for_missed_nights, settings)
    TakingUp(settings, tell=tell_of_left, look_for_missed=look_for_missed).start()
    return run_spec(wanted, settings, listener)


def _tell(record: RunRecord, command: Sequence[str], api_url: str | None, settings: Settings, *, as_json: bool) -> None:
    """Prints the result of a run on standard output, as JSON or as a summary with links to its pages."""
    from ...tasks.causes.stored import read_why
    from ...tasks.reporting.causes import why_in_lines
    from ...tasks.reporting.console_pages import pages_here
    from .output.comparison import changed_lines
    from .output.summary import print_summary
    from .prefect_server import pages

    if as_json:
        sys.stdout.write(record.model_dump_json(indent=2, exclude_none=True) + "\n")
    else:
        # Elsewhere the pages' address is not to be told from the API's.
        is_local = (api_url or "").startswith("http://127.0.0.1:")
        server = pages(api_url, os.environ.get("PREFECT_API_AUTH_STRING")) if api_url and is_local else ""
        page = pages_here(settings).run(record.run_id)
        why = list(why_in_lines(read_why(record.run_dir)))
        print_summary(record, command, sys.stdout, server=server, page=page, lost=changed_lines(record), why=why)
    sys.stdout.flush()


def settings_of(arguments: argparse.Namespace) -> Settings:
    """Returns the settings of a run, with the backend from the command line.

    Raises:
        ConfigurationError: A setting or the backend is invalid; nothing has been started.
    """
    from ...tasks.backends.backend import open_backend

    chosen = {"ROBOMAKER_BACKEND": arguments.backend} if arguments.backend else {}
    settings = Settings.from_environment({**os.environ, **chosen})
    open_backend(settings.backend)
    return settings


def _with_report(record: RunRecord, path: Path | None) -> RunRecord:
    if path is None or record.report_path is None:
        return record
    shutil.copyfile(record.report_path, path)
    return record.model_copy(update={"report_path": path})
