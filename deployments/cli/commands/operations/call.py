"""Call one operation, as an SDK would.

Takes the same input as the AWS CLI's --cli-input-json and --cli-input-yaml. Each operation with an
example: docs/operations.md; its members: robomaker schema OPERATION.
"""

import argparse
import os
import sys
from typing import TYPE_CHECKING, Any

from ...arguments import add_output
from ...output.answers import print_answer

if TYPE_CHECKING:
    from .....schemas.settings import Settings


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker call` to its parser."""
    parser.add_argument("operation", metavar="OPERATION", help="operation: DescribeWorld, describe-world, …")
    parser.add_argument(
        "--input", metavar="INPUT", default="{}", help="request: a file, JSON text, or - for standard input"
    )
    parser.add_argument(
        "--built-in",
        action="store_true",
        help="with ListRobotApplications, ListSimulationApplications: built-in ones, too",
    )
    parser.add_argument("--wait", action="store_true", help="carry a job to its end and print its final description")
    add_output(parser, "json", "yaml")
    parser.epilog = _operations_by_group()


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker call`: calls an API operation and prints its response; with `--wait` it carries a job to its end.

    Without `--wait` a job is only stored. Raises ConfigurationError if `--built-in` is given with an operation that
    lists no applications.
    """
    from .....schemas.operations.registry import OPERATIONS
    from .....schemas.settings import Settings
    from .....schemas.wire.errors import ConfigurationError
    from ...inputs.specifications import operation_name, read_request
    from ...job import order

    operation = operation_name(arguments.operation)
    request = read_request(arguments.input, operation)
    if arguments.built_in:
        if "builtIn" not in OPERATIONS[operation].request.model_fields:
            raise ConfigurationError(f"--built-in is for lists of applications, and {operation} is none")
        request = {**request, "builtIn": True}
    settings = Settings.from_environment(os.environ)
    if arguments.wait and OPERATIONS[operation].is_job:
        return order(operation, request, settings, arguments.output)
    answer = _stored(operation, request, settings)
    print_answer(answer, arguments.output)
    if operation in ("DescribeSimulationJob", "DescribeSimulationJobBatch"):
        _tell_waits(answer["arn"], settings)
    if operation.startswith("Describe") and operation.endswith(("Job", "Batch")):
        _tell_owner(answer["arn"], settings)
    if OPERATIONS[operation].is_job:
        sys.stderr.write(f"The job is stored; `robomaker perform {answer['arn']}` carries it to its end.\n")
    return 0


def _stored(operation: str, request: dict[str, Any], settings: "Settings") -> dict[str, Any]:
    from .....tasks.operations.registry import call
    from .....tasks.service.service import Service

    return call(operation, request, Service.open(settings))


def _tell_waits(arn: str, settings: "Settings") -> None:
    """Prints on standard error which jobs wait for memory or disk of this machine, as the response does not say it.

    It prints the given job, or each job of the given batch, with how long it has waited; nothing if none waits.
    """
    import time

    from .....tasks.machine.machine_slots import jobs_that_wait
    from ...output.answers import duration

    for record in jobs_that_wait(settings):
        if record.batch == arn or (record.batch is None and record.name == arn.rpartition("/")[2]):
            waited = duration(max(0.0, time.time() - record.since_s))
            sys.stderr.write(f"{record.name} has waited {waited} on this machine: {record.why}\n")


def _tell_owner(arn: str, settings: "Settings") -> None:
    """Prints on standard error which process runs a job, and which may continue it, as the response does not say it.

    Nothing is printed if that is not known.
    """
    from .....tasks.jobs.job_owners import standing_of
    from .....tasks.service.service import Service

    service = Service.open(settings)
    if (standing := standing_of(service.catalog.get(arn), service)) is None:
        return
    sys.stderr.write(f"{arn.rpartition('/')[2]}: {standing.in_words()}\n")
    if standing.waits_for_command:
        sys.stderr.write(f"Go on with it on {standing.machine}: {standing.command}\n")


def _operations_by_group() -> str:
    from .....schemas.operations.registry import OPERATION_GROUPS

    width = max(len(each.name) for group in OPERATION_GROUPS.values() for each in group)
    lines = ["operations:"]
    for title, group in OPERATION_GROUPS.items():
        lines += [f"  {title}", *(f"    {each.name:<{width}}  {each.description}" for each in group)]
    return "\n".join(lines)
