"""Fleets: how deployments stand, and what happens next."""

import argparse


def add_deployment(parser: argparse.ArgumentParser) -> None:
    """Adds the argument for the deployment job to decide about to a command's parser."""
    parser.add_argument("job", metavar="ARN", help="ARN of the deployment job")


def add_who(parser: argparse.ArgumentParser) -> None:
    """Adds the option for the person who decides to a command's parser."""
    parser.add_argument("--by", metavar="NAME", help="who says so, as DescribeDeploymentJob shows it (default: you)")
