"""Write a map for Nav2 of what a robot of some height meets.

FOLDER gets `map.pgm` and `map.yaml`. They mark solid parts from 2 cm above the floor up to the robot's height: legs
of a table, and its top only if the robot is that high. Doors and loose objects are where they are at first.
"""

import argparse
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from ....arguments import add_world


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker world map` to its parser."""
    add_world(parser)
    parser.add_argument("folder", metavar="FOLDER", help="a new folder for the map")
    parser.add_argument(
        "--robot-height", type=float, default=0.4, metavar="M", help="metres, 0.05 to 2; 0.4 unless told otherwise"
    )


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker world map`: writes a Nav2 map of a world for a robot's height, and prints its path.

    Raises ConfigurationError if the folder exists already, or the height does not do; nothing is written then.
    """
    from ......schemas.exit_codes import OK
    from ......schemas.wire.errors import ConfigurationError
    from ......tasks.worldforge.bundle.robot_map import write_robot_map
    from ......tasks.worldforge.exports.export_scene import read_scene
    from ....inputs.world_lookup import find_world

    found, folder = find_world(arguments.world), Path(arguments.folder)
    if folder.exists():
        raise ConfigurationError(f"{folder}: exists already; the map is written into a new folder")
    scene = read_scene(found.folder)
    with TemporaryDirectory() as scratch:
        try:
            write_robot_map(scene, Path(scratch), arguments.robot_height)
        except ValueError as error:
            raise ConfigurationError(f"--robot-height: {error}") from error
        shutil.copytree(scratch, folder)
    sys.stdout.write(f"{folder / 'map.yaml'}\n")
    return OK
