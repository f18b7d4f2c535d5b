"""Make a world of a floor plan that somebody drew, of a robot's map, or of a world in Gazebo's format.

An SVG or DXF file of rooms, doors and windows becomes a world of the catalog, proved like a generated one; so does,
coarsely, the map.yaml of an empty flat that a robot mapped. A YAML file of the same name beside a drawing says what it
does not: the scale, types of rooms, wishes for the interior; --notes names another.
A .world or .sdf file is taken as it is, with the models that it includes; nothing is fetched. Beside it, a YAML file of
the same name may name rooms and goals.
A folder of a ROS workspace, or the bundle of a simulation application (.tar.gz, .tar, .zip), may hold several Gazebo
worlds: they are listed, and --world names the one to import. Its start is x_pos, y_pos and yaw of the launch file that
starts it, unless --start names another. Launch files are read, never executed.
An import under a name that a world with the same content has is that world; the name of another world is refused.
Exit code 0: stored, all guarantees hold; 1: stored, some do not hold; 2: the file is none that a world can be made of.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ....arguments import add_output, finite_numbers
from ....inputs.options import open_service
from ....inputs.world_names import add_name, tell_same, world_name

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ......schemas.templates.drawing_notes import DrawingNotes
    from ......tasks.worldforge.drawings.drawing_import import Source
    from ......tasks.worlds.launch_starts import LaunchStart
    from ......tasks.worlds.workspaces import Workspace

    GazeboStart = tuple[float, float, float, float | None]
    """x, y, yaw and the height that the floor is near."""


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker world import` to its parser."""
    parser.add_argument(
        "plan",
        metavar="PLAN",
        help="plan.svg or plan.dxf, a map for Nav2, map.yaml, a world for Gazebo, x.world or x.sdf, or a workspace or "
        "bundle with such worlds",
    )
    add_name(parser)
    parser.add_argument("--notes", metavar="FILE", help="YAML file beside the drawing (default: PLAN with .yaml)")
    parser.add_argument(
        "--scale", metavar="M", help='metres for one unit of the drawing, or a scale on paper such as "1:50"'
    )
    parser.add_argument(
        "--seed", metavar="N", type=int, default=0, help="of materials and furniture; 0 unless told otherwise"
    )
    gazebo = parser.add_argument_group("worlds in Gazebo's format")
    gazebo.add_argument("--world", metavar="NAME", help="the world to import of a workspace or bundle with several")
    gazebo.add_argument(
        "--model-path",
        metavar="DIR",
        action="append",
        default=[],
        help="a folder of models, before those beside the world and in GAZEBO_MODEL_PATH; may be repeated",
    )
    gazebo.add_argument(
        "--start",
        metavar="X,Y[,YAW[,Z]]",
        type=_start,
        help="where robots start; Z is about the height of the floor they stand on. Without it: the free place nearest "
        "to 0,0, on the floor near height 0 or else on the lowest",
    )
    gazebo.add_argument(
        "--loose", choices=("free", "hold"), help="whether things that can move do (default), or are held"
    )
    gazebo.add_argument("--allow-missing", action="store_true", help="import without models that are not found")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker world import`: makes and stores a world of a drawing, map or Gazebo world, and prints its facts.

    Raises ConfigurationError if an option does not belong to the kind of the file, or a workspace has several worlds
    and none is named.
    """
    from ......schemas.wire.errors import ConfigurationError
    from ......tasks.worlds.gazebo_imports import SUFFIXES
    from ......tasks.worlds.workspaces import is_workspace
    from ....output.world_facts import print_kept

    plan, arguments.name = Path(arguments.plan), world_name(arguments.name)
    if is_workspace(plan):
        arn = _keep_of_workspace(arguments)
    elif arguments.world is not None:
        raise ConfigurationError(f"{plan}: --world is for workspaces and bundles with several worlds")
    elif plan.suffix.lower() in SUFFIXES:
        arn = _keep_gazebo(arguments, plan, arguments.start)
    else:
        arn = _keep_drawn(arguments)
    return print_kept(arn, arguments.output)


def _keep_of_workspace(arguments: argparse.Namespace) -> str:
    """Imports the world of a workspace or bundle, or lists its worlds and raises the error that one has to be named."""
    from ......schemas.wire.errors import ConfigurationError
    from ......tasks.worlds.workspaces import opened_workspace

    with opened_workspace(Path(arguments.plan), open_service()) as workspace:
        world = workspace.world(arguments.world)
        if world is None:
            _print_worlds(workspace, arguments.output)
            raise ConfigurationError(
                f"{arguments.plan}: it has {len(workspace.worlds)} Gazebo worlds; name one with --world, such as "
                f"--world {workspace.worlds[0].name}"
            )
        start = arguments.start or (world.start and _start_of(world.start))
        said = None if arguments.start or world.start is None else world.start.launch_file
        return _keep_gazebo(arguments, world.path, start, said, workspace.model_paths)


def _start_of(start: "LaunchStart") -> "GazeboStart":
    return start.x_m, start.y_m, start.yaw_rad, start.z_m


def _print_worlds(workspace: "Workspace", output: str) -> None:
    import json
    import sys

    listed = [
        {
            "name": world.name,
            "file": world.path.relative_to(workspace.top).as_posix(),
            "start": world.start and _start_of(world.start),
            "start_from": world.start and world.start.launch_file,
        }
        for world in workspace.worlds
    ]
    if output == "json":
        sys.stdout.write(json.dumps({"worlds": listed}, indent=2, ensure_ascii=False) + "\n")
        return
    for world in workspace.worlds:
        where = "no start"
        if (start := world.start) is not None:
            numbers = ",".join(f"{number:g}" for number in _start_of(start) if number is not None)
            where = f"start {numbers} of {start.launch_file}"
        sys.stdout.write(f"{world.name}  {world.path.relative_to(workspace.top).as_posix()}  {where}\n")


def _keep_drawn(arguments: argparse.Namespace) -> str:
    """Makes and stores the world of a drawing or map, with the notes beside it if there are some; returns its ARN.

    Raises ConfigurationError if an option is given that is for Gazebo worlds only.
    """
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
    return keep_world(world, "import", {}, open_service(), name=arguments.name, tell=tell_same).arn


def _keep_gazebo(
    arguments: argparse.Namespace,
    path: Path,
    start: "GazeboStart | None",
    start_from: str | None = None,
    more_models: "Sequence[Path]" = (),
) -> str:
    """Imports and stores a world in Gazebo's format, with the notes beside it if there are some; returns its ARN.

    Raises ConfigurationError if an option is given that is for drawings only.
    """
    from ......schemas.wire.errors import ConfigurationError
    from ......schemas.worlds.gazebo_notes import GazeboNotes
    from ......tasks.worldforge.drawings.drawn_shapes import read_yaml
    from ......tasks.worlds.gazebo_imports import GazeboImport, write_gazebo_bundle
    from ......tasks.worlds.keeping import keep_bundle

    if arguments.scale or arguments.seed:
        raise ConfigurationError(f"{arguments.plan}: --scale and --seed are for drawings")
    beside = Path(arguments.notes) if arguments.notes else path.with_suffix(".yaml")
    wanted = GazeboImport(
        path=path,
        model_paths=[*(_folder(each) for each in arguments.model_path), *more_models],
        start=start,
        start_from=start_from,
        loose=arguments.loose or "free",
        allow_missing=arguments.allow_missing,
        notes=read_yaml(beside, GazeboNotes) if arguments.notes or beside.is_file() else GazeboNotes(),
    )
    service = open_service()
    return keep_bundle(
        lambda folder: write_gazebo_bundle(wanted, folder),
        "import",
        {},
        service,
        name=arguments.name,
        tell=tell_same,
    ).arn


def _folder(name: str) -> Path:
    from ......schemas.wire.errors import ConfigurationError

    if not Path(name).is_dir():
        raise ConfigurationError(f"--model-path {name}: there is no such folder")
    return Path(name)


def _start(text: str) -> "GazeboStart":
    if (numbers := finite_numbers(text, 2, 3, 4)) is None:
        raise argparse.ArgumentTypeError(
            f"{text!r}: metres and radians, 3.5,1.0 or 3.5,1.0,1.57 or, with a height, 3.5,1.0,1.57,2.8, would be right"
        )
    x, y, yaw = [*numbers, 0.0][:3]
    return x, y, yaw, numbers[3] if len(numbers) > 3 else None


def _seed(number: int) -> int:
    from ......schemas.wire.errors import ConfigurationError

    if number < 0:
        raise ConfigurationError(f"--seed is {number}; 0 or more would be right")
    return number


def _notes(source: "Source", scale: str | None) -> "DrawingNotes":
    """Reads the drawing's notes, the defaults if it has none; the scale of the command line takes precedence.

    Raises ConfigurationError if `--scale` is no scale.
    """
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
