"""Fleets: how deployments stand, and what happens next."""

import argparse

__all__: list[str] = []


def add_deployment(parser: argparse.ArgumentParser) -> None:
    """Adds the deployment job that a person decides about."""
    parser.add_argument("job", metavar="ARN", help="ARN of the deployment job")


def add_who(parser: argparse.ArgumentParser) -> None:
    """Adds who decides."""
    parser.add_argument("--by", metavar="NAME", help="who says so, as DescribeDeploymentJob shows it (default: you)")
