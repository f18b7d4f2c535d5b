"""Take jobs of a batch and run them on this machine, until none is left.

The batch runs on another machine, with ROBOMAKER_BACKEND set there: a backend starts this command on
each of its machines. Started by hand it adds this machine to them. ROBOMAKER_CATALOG_URL and
ROBOMAKER_OBJECT_STORE have to lead to the same catalog and object store; ROBOMAKER_MAX_JOBS says how
many jobs run here at once.
"""

import argparse


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker work` to its parser."""
    parser.add_argument("batch", metavar="BATCH", help="ARN of the batch")
    parser.add_argument(
        "--end-with-input",
        action="store_true",
        help="release the jobs and end when standard input closes: what started this command has ended then",
    )


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker work`: runs a job worker for a batch; the exit code is independent of the jobs' verdicts."""
    from ...working import work

    return work(arguments.batch, end_with_input=arguments.end_with_input)
