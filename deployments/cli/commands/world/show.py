"""`robomaker world show`: a world's plan and proofs in words, and on demand in pictures."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from ...inputs.worlds import find_world
from ...output.world_facts import world_facts
from ...output.world_text import print_facts


def execute(arguments: argparse.Namespace) -> int:
    """Prints what there is to say of a world; draws it if a folder for pictures is given."""
    found = find_world(arguments.world)
    facts: dict[str, Any] = world_facts(found)
    if arguments.pictures:
        from .....tasks.worldforge.viewer.pictures import write_pictures

        facts["pictures"] = [str(path) for path in write_pictures(found.world, found.folder, Path(arguments.pictures))]
    if arguments.output == "json":
        sys.stdout.write(json.dumps(facts, indent=2, ensure_ascii=False) + "\n")
    else:
        print_facts(facts, sys.stdout)
    return 0
