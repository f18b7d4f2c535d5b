"""Show how fleets stand: robots with versions, orders and steps, and the latest deployment of each.

Without a name all fleets are shown. A large fleet is shown with the robots that need a look first; --all shows each.
"""

import argparse
import json
import sys

from ....cli.arguments import add_output
from ....cli.inputs.options import open_service


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker fleet status` to its parser."""
    parser.add_argument("fleet", metavar="FLEET", nargs="?", help="name or ARN of a fleet (default: all)")
    parser.add_argument("--all", action="store_true", help="all robots of large fleets")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker fleet status`: prints all fleets, or the one named, with their robots and deployments."""
    from .....tasks.fleet.views.fleet_standings import find_fleet, fleet_standing, fleets

    service = open_service()
    found = [find_fleet(arguments.fleet, service)] if arguments.fleet else list(fleets(service))
    standings = [fleet_standing(fleet, service) for fleet in found]
    if arguments.output == "json":
        shown = [each.model_dump(mode="json") for each in standings]
        sys.stdout.write(json.dumps({"schema_version": 1, "fleets": shown}, indent=2, ensure_ascii=False) + "\n")
    elif not standings:
        sys.stdout.write("There are no fleets; CreateFleet makes one.\n")
    else:
        from ...fleets_in_words import print_fleets

        print_fleets(standings, sys.stdout, everything=arguments.all, now=service.clock())
    return 0
