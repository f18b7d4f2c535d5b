"""Write a world's model in another light, for cameras.

FOLDER gets `world.xml` and its pictures. Only lights, the sky and what shines differ from the world's own model:
a robot moves through both alike, to the bit. Jobs take the environment variable ROBOMAKER_APPEARANCE instead.
"""

import argparse
import shutil
import sys
from pathlib import Path

from ....arguments import add_world


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker world relight` to its parser."""
    add_world(parser)
    parser.add_argument(
        "appearance",
        metavar="APPEARANCE",
        help="day, evening, night, lamps (night with the lamps on), quick (day without shadows: less than half the "
        "time a picture), or random: one of the first four, a little brighter or darker",
    )
    parser.add_argument("folder", metavar="FOLDER", help="a new folder for the model")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="what random draws from; equal: equal light")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker world relight`: writes a world's MJCF model with another lighting, and prints its path.

    The folder has to be new: raises ConfigurationError if it exists already, or there is no such appearance.
    """
    from ......schemas.exit_codes import OK
    from ......schemas.wire.errors import ConfigurationError
    from ......schemas.worlds.appearance import appearance_named, relit
    from ....inputs.world_lookup import find_world

    try:
        appearance = appearance_named(arguments.appearance, arguments.seed)
    except ValueError as error:
        raise ConfigurationError(str(error)) from error
    found, folder = find_world(arguments.world), Path(arguments.folder)
    if folder.exists():
        raise ConfigurationError(f"{folder}: exists already; the model is written into a new folder")
    folder.mkdir(parents=True)
    text = (found.folder / "world.xml").read_text(encoding="utf-8")
    for beside in ("textures", "meshes"):  # what the model names
        if (found.folder / beside).is_dir():
            shutil.copytree(found.folder / beside, folder / beside)
    (folder / "world.xml").write_text(relit(text, appearance), encoding="utf-8")
    sys.stdout.write(f"{folder / 'world.xml'}\n")
    return OK
