"""Run a simulation again and say whether all states are the same.

Exit code 0: bit-identical; 1: diverged, when and in which joint; 3: not comparable, and why.
Neither the job nor its outputs are touched.
"""

import argparse
import sys

from ...arguments import add_output, add_simulation
from ...inputs.options import open_service


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker verify` to its parser."""
    add_simulation(parser)
    parser.add_argument(
        "--run-program",
        action="store_true",
        help="run a robot application that is a program again too, instead of what was recorded of it",
    )
    add_output(parser, "text", "json")


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker verify`: repeats a simulation run, compares all states, and prints the answer.

    Returns the answer's exit code: whether the rerun is equal, differs, or could not be compared.
    """
    from .....schemas.runs.verification import EXIT_CODES
    from .....tasks.inspection.replays import verify_run

    service = open_service()
    verification = verify_run(arguments.run, service, trial=arguments.trial, run_program=arguments.run_program)
    text = verification.model_dump_json(indent=2) if arguments.output == "json" else str(verification)
    if verification.trial != arguments.trial and arguments.output != "json":
        text = f"trial {verification.trial}: {text}"
    sys.stdout.write(f"{text}\n")
    return EXIT_CODES[verification.answer]
