"""Cancel a deployment that waits for approval.

Robots that have the new version keep it; SyncDeploymentJob and a deployment of the earlier version are ways on.
"""

import argparse

from . import add_decision, decided


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet reject` to its parser."""
    add_decision(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet reject`: cancels a deployment that waits for approval."""
    from .....tasks.fleet.control.deployment_decisions import reject

    return decided(reject, arguments, "canceled, since it was not approved")
