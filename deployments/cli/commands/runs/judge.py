"""Judge a recording of a run, of a simulation or a real robot, by requirements.

RECORDING is an MCAP, a ROS 2 bag (SQLite or MCAP) or a ROS 1 bag. It is stored, and judged as a run with one job: rows,
report, JUnit file and exit code are those of `robomaker run`.
"""

import argparse
import os
import re
from pathlib import Path

from ...arguments import add_report, given_options
from ...inputs.options import output_file, spec_name


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker judge` to its parser."""
    parser.add_argument("recording", metavar="RECORDING", help="a .mcap, .db3 or .bag, or the folder of a ROS 2 bag")
    parser.add_argument(
        "--requirements", metavar="FILE", required=True, help="requirements, and the topics they are measured by: YAML"
    )
    parser.add_argument(
        "--world",
        metavar="WORLD",
        help="world that the robot was in, for goals that are rooms: name, id or its beginning, ARN",
    )
    parser.add_argument("--name", help="name of the run (default: that of FILE, which history and compare go by)")
    add_report(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker judge`: stores a ROS recording and judges it by requirements; the exit code is the verdict.

    Raises an error before anything is stored if the requirements, the world or the recording do not fit.
    """
    from .....schemas.settings import Settings
    from .....schemas.specs.check import load_spec
    from .....schemas.specs.yaml_nodes import parse, plain
    from .....tasks.inspection.judged_recordings import (
        asked_of,
        check_recording,
        check_world,
        judging_spec,
        store_recording,
    )
    from .....tasks.nights.wanted_runs import WantedRun
    from .....tasks.service.references import find_world
    from .....tasks.service.service import Service
    from ...inputs.specifications import read_text
    from ...specification_run import carry_out

    report = output_file(arguments.report, "--report")
    name = _name(arguments)
    given = parse(read_text(arguments.requirements), arguments.requirements)
    requirements, sources = asked_of(plain(given), arguments.requirements)
    check_world(requirements, arguments.world)
    recording = check_recording(Path(arguments.recording), sources)
    settings = Settings.from_environment(os.environ)
    with Service.opened(settings) as service:
        world: str | None = arguments.world
        if world is not None and not world.startswith("arn:"):
            world = find_world(world, service).arn
        keys = store_recording(recording, service)
    text = judging_spec(name, keys, requirements, sources, bucket=settings.bucket, world=world)
    spec = load_spec(text, arguments.requirements)
    return carry_out(WantedRun(spec, arguments.requirements, again(arguments)), settings, arguments, report=report)


def again(arguments: argparse.Namespace) -> list[str]:
    """Returns the command line that repeats the same judging."""
    command = ["robomaker", "judge", arguments.recording, "--requirements", arguments.requirements]
    return command + given_options(arguments, "world", "name", "report")


def _name(arguments: argparse.Namespace) -> str:
    if arguments.name is None:
        return re.sub(r"[^A-Za-z0-9_-]+", "-", Path(arguments.requirements).stem).strip("-_") or "judge"
    return spec_name(arguments.name)
