"""`robomaker verify`: runs a simulation again and says whether all states are the same."""

import argparse
import os
import sys

from ....schemas.runs.verification import EXIT_CODES
from ....schemas.settings import Settings


def execute(arguments: argparse.Namespace) -> int:
    """Prints what came of it; the exit code says the same."""
    from ....tasks.inspection.replays import verify_run
    from ....tasks.service.service import Service

    service = Service.open(Settings.from_environment(os.environ))
    verification = verify_run(arguments.run, service, run_program=arguments.run_program)
    text = verification.model_dump_json(indent=2) if arguments.output == "json" else str(verification)
    sys.stdout.write(f"{text}\n")
    return EXIT_CODES[verification.answer]
