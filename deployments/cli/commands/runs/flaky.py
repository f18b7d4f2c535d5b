"""Run failed jobs of a run again and again, and say what decides whether they pass.

Each is run up to 20 times in folders of its own; no history or comparison counts these reruns. Exit code 0: all repeat
bit by bit; 1: a job is flaky; 3: a job cannot be run again as it was.
"""

import argparse
import sys

from ...arguments import add_output
from ...inputs.options import open_service, read_record


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker flaky` to its parser."""
    parser.add_argument("run", metavar="RUN", help="id of a run, its specification's name, its folder, or latest")
    parser.add_argument(
        "--job",
        action="append",
        default=[],
        metavar="J",
        help="only this job, also if it passed: name, id or its beginning, ARN; may be given again (default: all that "
        "failed)",
    )
    parser.add_argument(
        "--reruns", type=int, metavar="N", help="reruns of each job at most, from 8 to 20 (default: 20)"
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker flaky`: runs jobs of a run again, and prints for each what decides how it ends.

    These are the failed jobs unless `--job` names others; the exit code is 0 if there are none. Raises
    ConfigurationError if `--reruns` is out of range.
    """
    from .....schemas.runs.verification import FlakyJobs
    from .....schemas.wire.errors import ConfigurationError
    from .....tasks.flakiness.flaky_jobs import FEWEST_RERUNS, all_jobs, examine, jobs_to_examine
    from .....tasks.flakiness.search import MOST_RERUNS

    most = MOST_RERUNS if arguments.reruns is None else arguments.reruns
    if not FEWEST_RERUNS <= most <= MOST_RERUNS:
        raise ConfigurationError(f"--reruns is {most}; a number from {FEWEST_RERUNS} to {MOST_RERUNS} would be right")
    service = open_service()
    record = read_record(service.settings.home / "runs", arguments.run)
    everything = all_jobs(record, service)
    jobs = jobs_to_examine(record, arguments.job, everything)
    if not jobs and arguments.output == "text":
        sys.stdout.write(f"nothing to run again: no job of the run {record.run_id} has failed\n")
        return 0
    took_s = sum(job.duration_s or 0.0 for job in jobs)
    from .....schemas.wire.common import counted

    count = counted(len(jobs), "job")
    sys.stderr.write(f"{count}, up to {most} reruns of each: about {most * took_s:.0f} s at most\n")
    found = FlakyJobs(run_id=record.run_id, jobs=[])
    for job in jobs:
        found.jobs.append(examine(job, everything, service, most))
        if arguments.output == "text":
            sys.stdout.write(f"{found.jobs[-1]}\n")
            sys.stdout.flush()
    if arguments.output == "json":
        sys.stdout.write(f"{found.model_dump_json(indent=2)}\n")
    return found.exit_code
