"""Make a world that differs from another in one thing, for tests of robustness.

The new world is stored beside the other one, says what differs, and is proved anew: it may break guarantees that the
other one keeps, such as that a robot reaches every room. Worlds that were imported from Gazebo are varied in light,
friction, and loose bodies that are moved or gone.
A variation under a name that a world with the same content has is that world; the name of another world is refused.
Exit code 0: all guarantees hold; 1: stored, some do not hold; 2: there is no such door or piece.
"""

import argparse
from typing import TYPE_CHECKING, get_args

from ....arguments import add_output, add_world, finite_numbers
from ....inputs.options import open_service
from ....inputs.world_names import add_name, tell_same, world_name

if TYPE_CHECKING:
    from ......tasks.worldforge.generator import Move


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker world vary` to its parser."""
    from ......schemas.worlds.world import Light

    add_world(parser)
    parser.add_argument(
        "--shut", metavar="DOOR", action="append", default=[], help="shut a door: its id, or its rooms, `Hall/Bedroom`"
    )
    parser.add_argument(
        "--open",
        metavar="DOOR[=PERCENT]",
        action="append",
        default=[],
        type=_opened,
        help="open a door, wholly or by some percent",
    )
    parser.add_argument(
        "--move",
        metavar="PIECE=EAST,NORTH[,TURN]",
        action="append",
        default=[],
        type=_moved,
        help="move a piece and what stands on it, in metres, and turn it counter-clockwise, in degrees",
    )
    parser.add_argument(
        "--remove", metavar="PIECE", action="append", default=[], help="take a piece away, and what stands on it"
    )
    parser.add_argument("--light", choices=get_args(Light), help="how cameras see it; at night no lamp is on")
    parser.add_argument(
        "--friction",
        metavar="[PIECE=]NUMBER",
        action="append",
        default=[],
        type=_rubbed,
        help="sliding friction of a piece, or of all, against whatever touches it; "
        "for worlds that were imported from Gazebo",
    )
    add_name(parser)
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker world vary`: makes a variation of a world, stores it as a new world, and prints facts about it.

    A door, piece or friction that is named twice is an error.
    """
    from ......tasks.worldforge.generator import Wanted
    from ......tasks.worlds.keeping import keep_variation
    from ....inputs.world_lookup import find_world
    from ....output.world_facts import print_kept

    doors = [*((door, 0.0) for door in arguments.shut), *arguments.open]
    _check_once("--shut, --open", [name for name, _ in doors])
    _check_once("--move, --remove", [*(name for name, _ in arguments.move), *arguments.remove])
    _check_once("--friction", [name for name, _ in arguments.friction])
    name = world_name(arguments.name)
    found = find_world(arguments.world)
    wanted = Wanted(dict(doors), dict(arguments.move), arguments.remove, arguments.light, dict(arguments.friction))
    kept = keep_variation(found.folder, wanted, found.arn, open_service(), name=name, tell=tell_same)
    return print_kept(kept.arn, arguments.output)


def _check_once(options: str, names: list[str]) -> None:
    """Raises an error if an option names the same door or piece more than once.

    Raises:
        ConfigurationError: A name is given more than once.
    """
    from ......schemas.wire.errors import ConfigurationError

    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(f"{options}: {name} is named {names.count(name)} times; once would be right")


def _opened(text: str) -> tuple[str, float]:
    name, _, percent = text.partition("=")
    try:
        number = float(percent or 100)
    except ValueError:
        number = -1.0
    if not name or not 0 <= number <= 100:
        raise argparse.ArgumentTypeError(f"{text!r}: a door such as door-2, or door-2=30 for 30 %, would be right")
    return name, number


def _moved(text: str) -> "tuple[str, Move]":
    from ......tasks.worldforge.generator import Move

    name, _, where = text.partition("=")
    numbers = finite_numbers(where, 2, 3)
    if not name or numbers is None:
        raise argparse.ArgumentTypeError(
            f"{text!r}: a piece and metres to the east and north, Sofas_1=0.5,-0.2, would be right"
        )
    return name, Move(*numbers)


def _rubbed(text: str) -> tuple[str, float]:
    name, _, number = text.rpartition("=")
    try:
        if name or "=" not in text:
            return name or "*", float(number)
    except ValueError:
        pass
    raise argparse.ArgumentTypeError(f"{text!r}: a number, 0.3, or a piece and one, crate=0.3, would be right")
