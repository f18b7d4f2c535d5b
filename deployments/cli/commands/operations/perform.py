"""Carry a stored job or batch to its end."""

import argparse
import os

from .....schemas.wire.errors import InvalidParameterException
from ...arguments import add_output

_OPERATIONS = {
    "simulation-job": "CreateSimulationJob",
    "simulation-job-batch": "StartSimulationJobBatch",
    "world-generation-job": "CreateWorldGenerationJob",
    "world-export-job": "CreateWorldExportJob",
    "deployment-job": "CreateDeploymentJob",
}


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    parser.add_argument("arn", metavar="ARN", help="ARN of the job, as `call` printed it")
    add_output(parser, "json", "yaml")


def execute(arguments: argparse.Namespace) -> int:
    """Runs the job to its end and prints its final description; the exit code tells its outcome."""
    from .....schemas.settings import Settings
    from .....schemas.wire.arns import ResourceArn
    from ...job import perform

    kind = ResourceArn.parse(arguments.arn).kind
    if kind not in _OPERATIONS:
        raise InvalidParameterException(f"{arguments.arn} names a {kind}; jobs and batches can be performed")
    return perform(_OPERATIONS[kind], arguments.arn, Settings.from_environment(os.environ), arguments.output)
