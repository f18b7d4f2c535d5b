"""Store outputs that could not be stored when their runs ended.

They are in the data home of the machine that ran them. Of each job it says then where its outputs are; the job stays
`Failed`, as clients have seen it, and has the verdict of its run again.
"""

import argparse
from typing import TYPE_CHECKING

from ...arguments import add_output
from ...inputs.options import open_service
from ...output.answers import print_either

if TYPE_CHECKING:
    from .....schemas.reports.retention import KeptReport, KeptRun
    from .....tasks.jobs.job_folders import KeptOutputs
    from .....tasks.service.service import Service


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker upload` to its parser."""
    parser.add_argument("--kept", action="store_true", required=True, help="outputs that were kept on this machine")
    parser.add_argument("job", metavar="JOB", nargs="?", help="ARN or id of a simulation job (default: all)")
    parser.add_argument("--dry-run", action="store_true", help="only list them")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker upload`: uploads outputs whose upload failed; with `--dry-run` it only shows them.

    Returns exit code 3 if some fail again.
    """
    from .....schemas.reports.retention import KeptReport
    from .....tasks.jobs.job_folders import find_kept

    service = open_service()
    runs = [_seen_to(kept, service, dry_run=arguments.dry_run) for kept in find_kept(service, arguments.job)]
    report = KeptReport(dry_run=arguments.dry_run, runs=runs)
    print_either(arguments.output, report, _lines(report))
    return 3 if report.problems else 0


def _seen_to(kept: "KeptOutputs", service: "Service", *, dry_run: bool) -> "KeptRun":
    """Uploads the outputs of one run, without waiting for a store that is away; only looks if `dry_run` is true.

    A failure does not end the command: it is the `problem` of the answer.
    """
    from dataclasses import replace

    from .....schemas.reports.retention import KeptRun
    from .....schemas.wire.errors import RobomakerError
    from .....tasks.jobs.job_folders import store_kept

    sizes = [path.stat().st_size for path in kept.files()]
    run = KeptRun(
        job=kept.job.arn,
        job_status=kept.job.status,
        run_id=kept.run_id,
        folder=str(kept.output_dir),
        files=len(sizes),
        size_bytes=sum(sizes),
    )
    if dry_run:
        return run
    # A person who waits would rather hear that the store is still away.
    hasty = replace(service, timing=replace(service.timing, store_patience_s=0.0))
    try:
        place = store_kept(kept, hasty)
    except (RobomakerError, OSError) as error:
        return run.model_copy(update={"problem": str(error)})
    return run.model_copy(update={"state": "stored", "place": service.store.uri(place.bucket, place.prefix)})


def _lines(report: "KeptReport") -> list[str]:
    from rich.filesize import decimal

    from .....schemas.wire.common import counted

    lines: list[str] = []
    for run in report.runs:
        size = f"{counted(run.files, 'file')}, {decimal(run.size_bytes)}"
        what = f"{run.job.rpartition('/')[2]}  {run.run_id}  {size}"
        where = f"stored in {run.place}" if run.place else f"kept in {run.folder}"
        lines += [f"{what}  {where}", *([f"! not stored: {run.problem}"] if run.problem else [])]
    if not report.runs:
        return ["No outputs are kept: all that ran is stored, or was never written on this machine."]
    runs = counted(len(report.runs), "run")
    stored = sum(run.state == "stored" for run in report.runs)
    if report.dry_run:
        return [*lines, f"{runs}; `robomaker upload --kept` stores them."]
    return [*lines, f"Stored the outputs of {stored} of {runs}."]
