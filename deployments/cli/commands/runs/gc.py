"""Remove old runs, their outputs and jobs, and worlds that nothing needs.

What no rule keeps goes: what is old enough, is not among the newest of its specification, and did not fail where
failures are kept. What runs, and what a kept report or a deployed specification names, always stays. It is shown first,
and asked about.
"""

import argparse
import os
import sys
from typing import TYPE_CHECKING

from .....schemas.wings import parts_of_wings
from .....schemas.wire.errors import ConfigurationError
from ...arguments import add_output
from ...output.answers import print_either

if TYPE_CHECKING:
    from .....schemas.reports.retention import GcReport, RetentionPolicy
    from .....schemas.settings import Settings
    from .....tasks.service.service import Service

_LEFT = "to be removed"
"""Beginning of the printed notes about files and containers that dead processes left behind."""


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker gc` to its parser."""
    parser.add_argument("--older-than", metavar="TIME", help="keep what ended within this time: 30d, 12h, 8w")
    parser.add_argument("--keep-runs", metavar="N", type=int, help="keep the newest N runs of each specification")
    parser.add_argument("--keep-failures", action="store_true", help="keep runs that did not succeed")
    parser.add_argument(
        "--keep-results",
        action="store_true",
        help="remove only recordings, videos, logs and uploads; records, reports, results and what verify needs stay",
    )
    parser.add_argument("--sdk-jobs", action="store_true", help="also jobs that SDKs or `call` ordered, not a run")
    parser.add_argument(
        "--orphaned-worlds",
        action="store_true",
        help="also generated worlds and variations that no run, no job and no deployed specification names; imported "
        "ones stay",
    )
    parser.add_argument(
        "--imported-worlds",
        action="store_true",
        help="also worlds of `world import` that no run, no job and no deployed specification names",
    )
    parser.add_argument(
        "--orphaned-recordings", action="store_true", help="also recordings stored by `judge` that nothing names"
    )
    for part in parts_of_wings("deployments", "gc"):
        part.declare(parser)
    parser.add_argument("--dry-run", action="store_true", help="only show what would be removed")
    parser.add_argument("-y", "--yes", action="store_true", help="do not ask")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker gc`: deletes old runs and worlds, after a question unless `--yes` is given.

    With `--dry-run` it only shows them. Returns exit code 3 if something could not be deleted. Raises
    ConfigurationError if there is no terminal to ask on.
    """
    from .....schemas.settings import Settings

    policy = _policy(arguments)
    policy.check()
    if not (arguments.dry_run or arguments.yes or _can_ask(arguments)):
        raise ConfigurationError("there is no terminal to ask on; --yes removes, --dry-run only shows")
    settings = Settings.from_environment(os.environ)
    if arguments.dry_run or not arguments.yes:
        report = _collected(policy, settings, act=False)
        if arguments.dry_run:
            return _told(report, arguments)
        _told(report, arguments)
        is_left = any(note.startswith(_LEFT) for note in report.notes)
        if not (report.removed or report.flow_runs.count or report.flow_runs.freed_bytes or is_left):
            return 0
        sys.stderr.write("Remove them? [y/N] ")
        sys.stderr.flush()
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            sys.stderr.write("Nothing was removed.\n")
            return 0
    return _told(_collected(policy, settings, act=True), arguments)


def _can_ask(arguments: argparse.Namespace) -> bool:
    return sys.stdin.isatty() and arguments.output == "text"


def _policy(arguments: argparse.Namespace) -> "RetentionPolicy":
    from .....schemas.reports.retention import RetentionPolicy
    from ...inputs.options import time_span

    if arguments.keep_runs is not None and arguments.keep_runs < 0:
        raise ConfigurationError(f"--keep-runs is {arguments.keep_runs}; it has to be a whole number from 0")
    of_wings = [part.rules(arguments) for part in parts_of_wings("deployments", "gc")]
    return RetentionPolicy(
        older_than=time_span(arguments.older_than, "--older-than") if arguments.older_than is not None else None,
        keep_runs=arguments.keep_runs,
        keep_failures=arguments.keep_failures,
        keep_results=arguments.keep_results,
        sdk_jobs=arguments.sdk_jobs,
        orphaned_worlds=arguments.orphaned_worlds,
        imported_worlds=arguments.imported_worlds,
        orphaned_recordings=arguments.orphaned_recordings,
        **{name: value for rules in of_wings for name, value in rules.items()},
    )


def _collected(policy: "RetentionPolicy", settings: "Settings", *, act: bool) -> "GcReport":
    from .....tasks.retention.collection import collect, plan_collection
    from .....tasks.service.service import Service
    from ....deploying.stored_deployments import stored_deployments
    from ....flow_run_history import collect_flow_runs

    with Service.opened(settings) as service:
        report = (collect if act else plan_collection)(policy, service, stored_deployments(settings))
        flow_runs = collect_flow_runs(settings, policy, service.clock(), act=act)
        notes = [*report.notes, *_left_behind(settings, service, act=act), *_kept_outputs(service)]
        return report.model_copy(update={"flow_runs": flow_runs, "notes": notes})


def _left_behind(settings: "Settings", service: "Service", *, act: bool) -> list[str]:
    """Describes files of processes that died or lost their jobs, and deletes them if `act`, whatever the policy is."""
    from .....tasks.jobs.job_folders import overtaken_runs, remove_overtaken_runs
    from .....tasks.runtime.process.rehearsal_folders import abandoned_folders, remove_abandoned_folders
    from ....flow_run_history import collect_limits

    runs = len(remove_overtaken_runs(service) if act else overtaken_runs(service))
    limits = len(collect_limits(settings, service, act=act))
    told = [f"{runs} folder(s) of runs that other processes took over"] if runs else []
    told += [f"{limits} concurrency limit(s) of batches that have ended"] if limits else []
    rooms = len(remove_abandoned_folders() if act else list(abandoned_folders()))
    told += [f"{rooms} folder(s) in which job workers that were killed had rehearsed"] if rooms else []
    return [f"{'removed' if act else _LEFT}: {each}" for each in told]


def _kept_outputs(service: "Service") -> list[str]:
    """Returns a line of text on outputs that exist only on this machine; no line if there are none."""
    from .....tasks.jobs.job_folders import find_kept

    if not (kept := find_kept(service)):
        return []
    runs = f"{len(kept)} {'run' if len(kept) == 1 else 'runs'}"
    return [f"outputs of {runs} could not be stored and are here only: `robomaker upload --kept` stores them"]


def _told(report: "GcReport", arguments: argparse.Namespace) -> int:
    from ...output.retention import report_lines

    print_either(arguments.output, report, report_lines(report))
    return 3 if report.problems else 0
