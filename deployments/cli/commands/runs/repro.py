"""Put a simulation into a folder, run it again with video, and write a pytest file for it.

The folder has all that the run needs: world, application bundles, data, seed.
"""

import argparse
import re
import shlex
import sys
from pathlib import Path

from ...arguments import add_output, add_simulation
from ...inputs.options import open_service


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker repro` to its parser."""
    add_simulation(parser)
    parser.add_argument("--to", metavar="FOLDER", help="put it there (default: repro-<job id>)")
    parser.add_argument("--no-video", action="store_true", help="do not record a video of the rerun")
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker repro`: repeats a simulation run, and writes a folder with everything to repeat it elsewhere.

    Returns 0 also if the rerun ended otherwise than the run, which is printed.
    """
    from .....schemas.runs.verification import ROBOT_IN_WORDS
    from .....tasks.inspection.replays import reproduce_run

    name = _name_of(arguments.run) if arguments.trial is None else f"{_name_of(arguments.run)}-trial-{arguments.trial}"
    folder = Path(arguments.to or f"repro-{name}")
    service = open_service()
    made = reproduce_run(arguments.run, folder, service, "none" if arguments.no_video else "always", arguments.trial)
    if arguments.output == "json":
        sys.stdout.write(made.model_dump_json(indent=2) + "\n")
        return 0
    as_before = "as the run did" if made.same_ending else "which is not how the run ended"
    if made.trial != arguments.trial:
        sys.stdout.write(
            f"Trial {made.trial} is repeated, as --trial names none: the first that did not pass, else 0.\n"
        )
    sys.stdout.write(f"The rerun {made.ending}, {as_before}{ROBOT_IN_WORDS[made.robot]}.\n")
    if made.other_inputs:
        sys.stdout.write(f"It is not the same run: {'; '.join(made.other_inputs)}. The folder has what there is now.\n")
    if made.video is not None:
        sys.stdout.write(f"Video: {made.video}\n")
    sys.stdout.write(f"Run it again: python -m pytest {shlex.quote(str(made.test))}\n")
    return 0


def _name_of(run: str) -> str:
    """Returns the last component of an ARN, id, name, `s3://` URL or path, to name a folder after the run."""
    last = run.rstrip("/").replace("/", ":").rsplit(":", 1)[-1]
    return re.sub(r"[^A-Za-z0-9._=-]+", "-", last).strip("-") or "run"
