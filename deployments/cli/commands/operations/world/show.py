"""Print a world's plan, what was proven of it, and which wishes it misses."""

import argparse
import sys
import time
from pathlib import Path
from typing import Any

from ....arguments import add_output, add_world


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker world show` to its parser."""
    add_world(parser)
    parser.add_argument(
        "--pictures", metavar="FOLDER", help="put the plan, a view from above and one from inside each room there"
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker world show`: prints facts about a world; with `--pictures` it writes pictures into a folder."""
    from ....inputs.world_lookup import find_world
    from ....output.answers import duration
    from ....output.world_facts import fact_lines, print_world, world_facts

    found = find_world(arguments.world)
    facts: dict[str, Any] = world_facts(found)
    if arguments.pictures:
        from ......tasks.worldforge.viewer.viewer_page import write_pictures

        began_s = time.monotonic()

        def tell(line: str) -> None:
            sys.stderr.write(f"[{duration(time.monotonic() - began_s):>12}] {line}\n")
            sys.stderr.flush()

        written = write_pictures(found.world, found.folder, Path(arguments.pictures), tell)
        facts["pictures"] = [str(path) for path in written]
    print_world(arguments.output, facts, fact_lines(facts))
    return 0
