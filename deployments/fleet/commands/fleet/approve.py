"""Approve a deployment that waits for it, so that it goes on.

A deployment with requiresApproval waits once its canaries have ended, or before its first robot where it has none;
it cannot be approved before.
"""

import argparse

from . import add_decision, decided


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet approve` to its parser."""
    add_decision(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet approve`: approves a deployment that waits for approval."""
    from .....tasks.fleet.control.deployment_decisions import approve

    return decided(approve, arguments, "approved")
