"""Measure a world anew, and say which guarantees hold.

Worlds of any generator are measured as new ones are. Nothing is changed, neither the world nor what it says of itself.
Exit code 0: all guarantees hold; 1: some do not.
"""

import argparse

from ....arguments import add_output, add_world


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker world prove` to its parser."""
    add_world(parser)
    parser.add_argument(
        "--pushed",
        action="store_true",
        help="also push all loose objects a little, 8 times, and see for 30 s each time that they stay",
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker world prove`: prints a world's measured guarantees; the exit code says whether they hold."""
    from dataclasses import replace

    from ......schemas.exit_codes import OK, VERDICT_FAILED
    from ......schemas.wire.errors import ConfigurationError
    from ......schemas.worlds.world import GazeboSource
    from ......tasks.worldforge.bundle.bundle import NAMES_FILE
    from ......tasks.worldforge.gazebo.outline import prove_imported
    from ......tasks.worldforge.proofs.checks import prove
    from ....inputs.world_lookup import find_world
    from ....output.world_facts import print_world, proof_lines_of, world_facts

    found = find_world(arguments.world)
    if (found.folder / NAMES_FILE).is_file():
        raise ConfigurationError(
            f"{found.folder} is a world of an export, in whose world.xml names do not tell what is a part of what; "
            "the world's ARN or its bundle would be right"
        )
    try:
        if isinstance(found.world.source, GazeboSource):
            if arguments.pushed:
                raise ConfigurationError("--pushed: worlds that were imported from Gazebo are not pushed")
            checks = prove_imported(found.world, found.folder / "world.xml")
        else:
            checks = prove(found.world, found.folder / "world.xml", pushed=arguments.pushed)
    except ValueError as error:
        raise ConfigurationError(f"{found.folder / 'world.xml'} is no model that MuJoCo accepts: {error}") from error
    facts = world_facts(replace(found, world=found.world.model_copy(update={"checks": checks})))
    proofs = {name: facts[name] for name in ("name", "arn", "generator_version", "proven", "broken", "proofs")}
    # As in `world.json`: only of imported Gazebo worlds this area is measured.
    absent = {"reachable_m2"} if checks.reachable_m2 is None else set[str]()
    checked = {**proofs, "checks": checks.model_dump(mode="json", exclude=absent)}
    print_world(arguments.output, checked, proof_lines_of(facts))
    return OK if facts["proven"] else VERDICT_FAILED
