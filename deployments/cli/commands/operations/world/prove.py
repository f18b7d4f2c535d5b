"""Measure a world anew from its files, and say which guarantees hold.

Worlds of any generator, and imported ones, are measured as new ones are: on the model, the map and the other files of
the bundle, which are held against each other. What is wrong is named with its place. Nothing is changed.
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
    """Runs `robomaker world prove`: measures a world's guarantees anew and prints them; the exit code says if all hold.

    Raises ConfigurationError if the world is an export, or its model is one that MuJoCo does not accept, or
    `--pushed` is given for a world that was imported from Gazebo.
    """
    from dataclasses import replace

    from ......schemas.exit_codes import OK, VERDICT_FAILED
    from ......schemas.wire.errors import ConfigurationError
    from ......schemas.worlds.world import GazeboSource
    from ......tasks.worldforge.bundle.bundle import NAMES_FILE
    from ......tasks.worldforge.bundle.proving import prove
    from ....inputs.world_lookup import find_world, stored_digests
    from ....output.world_facts import print_world, proof_lines_of, world_facts

    found = find_world(arguments.world)
    if (found.folder / NAMES_FILE).is_file():
        raise ConfigurationError(
            f"{found.folder} is a world of an export, in whose world.xml names do not tell what is a part of what; "
            "the world's ARN or its bundle would be right"
        )
    if arguments.pushed and isinstance(found.world.source, GazeboSource):
        raise ConfigurationError("--pushed: worlds that were imported from Gazebo are not pushed")
    try:
        checks = prove(found.world, found.folder, digests=stored_digests(found), pushed=arguments.pushed)
    except ValueError as error:
        raise ConfigurationError(f"{found.folder / 'world.xml'} is no model that MuJoCo accepts: {error}") from error
    facts = world_facts(replace(found, world=found.world.model_copy(update={"checks": checks})))
    proofs = {name: facts[name] for name in ("name", "id", "arn", "generator_version", "proven", "broken", "proofs")}
    checked = {**proofs, "checks": checks.model_dump(mode="json", exclude=checks.absent())}
    print_world(arguments.output, checked, proof_lines_of(facts))
    return OK if facts["proven"] else VERDICT_FAILED
