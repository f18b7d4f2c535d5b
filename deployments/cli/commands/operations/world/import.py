"""Make a world of a floor plan that somebody drew, of a robot's map, or of a world in Gazebo's format.

An SVG or DXF file of rooms, doors and windows becomes a world of the catalog, proved like a generated one; so does,
coarsely, the map.yaml of an empty flat that a robot mapped. A YAML file of the same name beside a drawing says what it
does not: the scale, types of rooms, wishes for the interior; --notes names another.
A .world or .sdf file is taken as it is, with the models that it includes; nothing is fetched. Beside it, a YAML file of
the same name may name rooms and goals.
Exit code 0: stored, all guarantees hold; 1: stored, some do not hold; 2: the file is none that a world can be made of.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ....arguments import add_output, two_or_three_numbers
from ....inputs.options import open_service

if TYPE_CHECKING:
    from ......schemas.templates.drawing_notes import DrawingNotes
    from ......tasks.worldforge.drawings.drawing_import import Source


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker world import` to its parser."""
    parser.add_argument(
        "plan",
        metavar="PLAN",
        help="plan.svg or plan.dxf, a map for Nav2, map.yaml, or a world for Gazebo, x.world or x.sdf",
    )
    parser.add_argument("--notes", metavar="FILE", help="YAML file beside the drawing (default: PLAN with .yaml)")
    parser.add_argument(
        "--scale", metavar="M", help='metres for one unit of the drawing, or a scale on paper such as "1:50"'
    )
    parser.add_argument(
        "--seed", metavar="N", type=int, default=0, help="of materials and furniture; 0 unless told otherwise"
    )
    gazebo = parser.add_argument_group("worlds in Gazebo's format")
    gazebo.add_argument(
        "--model-path",
        metavar="DIR",
        action="append",
        default=[],
        help="a folder of models, before those beside the world and in GAZEBO_MODEL_PATH; may be repeated",
    )
    gazebo.add_argument(
        "--start", metavar="X,Y[,YAW]", type=_start, help="where robots start; without, the free place nearest to 0,0"
    )
    gazebo.add_argument(
        "--loose", choices=("free", "hold"), help="whether things that can move do (default), or are held"
    )
    gazebo.add_argument("--allow-missing", action="store_true", help="import without models that are not found")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker world import`: makes a world of a drawing or map, and reports deviations from it."""
    from ......tasks.worldforge.gazebo.importing import SUFFIXES
    from ....output.world_facts import print_kept

    keep = _keep_gazebo if Path(arguments.plan).suffix.lower() in SUFFIXES else _keep_drawn
    return print_kept(keep(arguments), arguments.output)


def _keep_drawn(arguments: argparse.Namespace) -> str:
    """Makes and stores the world of a drawing; returns its ARN."""
    from ......schemas.wire.errors import ConfigurationError
    from ......tasks.worldforge.drawings.drawing_import import READERS, Source, import_world
    from ......tasks.worlds.keeping import keep_world

    if arguments.model_path or arguments.start or arguments.loose or arguments.allow_missing:
        raise ConfigurationError(
            f"{arguments.plan}: --model-path, --start, --loose and --allow-missing are for worlds in Gazebo's format"
        )
    drawing = Path(arguments.plan)
    beside = Path(arguments.notes) if arguments.notes else drawing.with_suffix(".yaml")
    has_notes = arguments.notes or (drawing.suffix.lower() in READERS and beside.is_file())
    source = Source(drawing, beside if has_notes else None)
    world = import_world(source, _notes(source, arguments.scale), _seed(arguments.seed))
    return keep_world(world, "import", {}, open_service()).arn


def _keep_gazebo(arguments: argparse.Namespace) -> str:
    """Imports and stores a world in Gazebo's format; returns its ARN."""
    from ......schemas.wire.errors import ConfigurationError
    from ......schemas.worlds.gazebo_notes import GazeboNotes
    from ......tasks.worldforge.drawings.drawn_shapes import read_yaml
    from ......tasks.worlds.gazebo_imports import GazeboImport, write_gazebo_bundle
    from ......tasks.worlds.keeping import keep_bundle

    if arguments.scale or arguments.seed:
        raise ConfigurationError(f"{arguments.plan}: --scale and --seed are for drawings")
    path = Path(arguments.plan)
    beside = Path(arguments.notes) if arguments.notes else path.with_suffix(".yaml")
    wanted = GazeboImport(
        path=path,
        model_paths=[_folder(each) for each in arguments.model_path],
        start=arguments.start,
        loose=arguments.loose or "free",
        allow_missing=arguments.allow_missing,
        notes=read_yaml(beside, GazeboNotes) if arguments.notes or beside.is_file() else GazeboNotes(),
    )
    return keep_bundle(lambda folder: write_gazebo_bundle(wanted, folder), "import", {}, open_service()).arn


def _folder(name: str) -> Path:
    from ......schemas.wire.errors import ConfigurationError

    if not Path(name).is_dir():
        raise ConfigurationError(f"--model-path {name}: there is no such folder")
    return Path(name)


def _start(text: str) -> tuple[float, float, float]:
    if (numbers := two_or_three_numbers(text)) is None:
        raise argparse.ArgumentTypeError(f"{text!r}: metres and radians, 3.5,1.0 or 3.5,1.0,1.57, would be right")
    x, y, *yaw = numbers
    return x, y, yaw[0] if yaw else 0.0


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
    from ......tasks.worldforge.drawings.drawn_shapes import read_notes

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
