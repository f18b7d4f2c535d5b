"""Fleets: how deployments stand, and what happens next."""

import argparse
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .....tasks.service.service import Service


def add_deployment(parser: argparse.ArgumentParser) -> None:
    """Adds the argument for the deployment job to decide about to a command's parser."""
    parser.add_argument("job", metavar="ARN", help="ARN of the deployment job")


def add_decision(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of a person's decision about a deployment to a command's parser."""
    add_deployment(parser)
    parser.add_argument("--by", metavar="NAME", help="who says so, as DescribeDeploymentJob shows it (default: you)")


def decided(decide: "Callable[[str, str, Service], None]", arguments: argparse.Namespace, outcome: str) -> int:
    """Carries out a person's decision about a deployment, and prints its outcome.

    Args:
        decide: The decision: deployment job, person, service.
        arguments: Parsed arguments of `add_decision`.
        outcome: Text to print after the deployment's ARN.
    """
    from ....cli.inputs.options import open_service, who

    decide(arguments.job, who(arguments.by), open_service())
    sys.stdout.write(f"{arguments.job}: {outcome}\n")
    return 0
