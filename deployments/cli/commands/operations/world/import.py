"""Make a furnished world of a floor plan that somebody drew.

An SVG or DXF file of rooms, doors and windows becomes a world of the catalog, proved like a generated one; so does,
coarsely, the map.yaml of an empty flat that a robot mapped. A YAML file of the same name beside a drawing says what it
does not: the scale, types of rooms, wishes for the interior; --notes names another.
Exit code 0: stored, all guarantees hold; 2: the file draws no plan that a world can have.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ....arguments import add_output
from ....inputs.options import open_service

if TYPE_CHECKING:
    from ......schemas.templates.drawing_notes import DrawingNotes
    from ......tasks.worldforge.drawings.importing import Source


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments."""
    parser.add_argument("plan", metavar="PLAN", help="the drawing, plan.svg or plan.dxf, or a map for Nav2, map.yaml")
    parser.add_argument("--notes", metavar="FILE", help="YAML file beside the drawing (default: PLAN with .yaml)")
    parser.add_argument(
        "--scale", metavar="M", help='metres for one unit of the drawing, or a scale on paper such as "1:50"'
    )
    parser.add_argument(
        "--seed", metavar="N", type=int, default=0, help="of materials and furniture; 0 unless told otherwise"
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Makes the world, stores it and says how far it is as drawn."""
    from ......tasks.worldforge.drawings.importing import READERS, Source, import_world
    from ......tasks.worlds.keeping import keep_world
    from ....inputs.worlds import find_world
    from ....output.world_facts import print_kept, world_facts

    drawing = Path(arguments.plan)
    beside = Path(arguments.notes) if arguments.notes else drawing.with_suffix(".yaml")
    has_notes = arguments.notes or (drawing.suffix.lower() in READERS and beside.is_file())
    source = Source(drawing, beside if has_notes else None)
    world = import_world(source, _notes(source, arguments.scale), _seed(arguments.seed))
    service = open_service()
    kept = keep_world(world, "import", {}, service)
    facts = world_facts(find_world(kept.arn))
    if arguments.output == "json":
        sys.stdout.write(json.dumps(facts, indent=2, ensure_ascii=False) + "\n")
    else:
        print_kept(facts, sys.stdout)
    return 0


def _seed(number: int) -> int:
    from ......schemas.wire.errors import ConfigurationError

    if number < 0:
        raise ConfigurationError(f"--seed is {number}; 0 or more would be right")
    return number


def _notes(source: "Source", scale: str | None) -> "DrawingNotes":
    """Reads the drawing's notes; the scale of the command line takes precedence."""
    from pydantic import ValidationError

    from ......schemas.templates.drawing_notes import DrawingNotes
    from ......schemas.wire.errors import ConfigurationError
    from ......tasks.worldforge.drawings.shapes import read_notes

    notes = read_notes(source.notes) if source.notes else DrawingNotes()
    if scale is None:
        return notes
    number = scale.replace(".", "", 1).isdecimal()
    try:
        stated = DrawingNotes.model_validate({"scale": float(scale) if number else scale})
    except ValidationError:
        raise ConfigurationError(
            f'--scale is {scale!r}; metres a unit, such as 0.01, or a scale on paper, "1:50", would be right'
        ) from None
    return notes.model_copy(update={"scale": stated.scale})
