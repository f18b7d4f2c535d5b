"""Options of `robomaker gc` for fleets."""

import argparse
from typing import Any

from ...schemas.wire.errors import ConfigurationError


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the options for robot deployments to the parser of `robomaker gc`."""
    parser.add_argument(
        "--keep-deployments",
        metavar="N",
        type=int,
        help="also files for robots that neither the newest N deployments of a fleet nor a robot needs",
    )


def rules(arguments: argparse.Namespace) -> dict[str, Any]:
    """Returns the members of `RetentionPolicy` from the options.

    Raises:
        ConfigurationError: A number is below 0.
    """
    keep = arguments.keep_deployments
    if keep is not None and keep < 0:
        raise ConfigurationError(f"--keep-deployments is {keep}; it has to be a whole number from 0")
    return {"keep_deployments": keep}
