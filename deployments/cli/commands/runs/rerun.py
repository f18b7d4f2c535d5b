"""Run jobs of an earlier run again: all of them, or those that failed, of some worlds, or by name.

Worlds, seeds and requests are those of the earlier run; applications are what they are now. The options combine:
`--failed --world W` runs again what failed in the world W. When nothing has failed, nothing is run and the exit code
is 0; otherwise it says how the rerun ended, as that of `robomaker run` does.
"""

import argparse
import sys

from ...arguments import add_backend, add_report, given_options
from ...inputs.options import output_file, read_record


def declare(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of `robomaker rerun` to its parser."""
    parser.add_argument("run", metavar="RUN", help="id of a run, its specification's name, its folder, or latest")
    parser.add_argument(
        "--failed", action="store_true", help="only jobs without a good result: failed, broken, cancelled, never begun"
    )
    parser.add_argument(
        "--job",
        action="append",
        default=[],
        metavar="J",
        help="only this job: name (`scout in flat 3`), id or its beginning, ARN; may be given again",
    )
    parser.add_argument(
        "--world",
        action="append",
        default=[],
        metavar="W",
        help="only jobs in this world: name (`flat 3`), world-3, id; likewise",
    )
    parser.add_argument(
        "--timeout-s",
        type=int,
        metavar="N",
        help="seconds after which each batch is ended, instead of the earlier run's timeoutInSeconds",
    )
    add_backend(parser)
    add_report(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Runs `robomaker rerun`: runs jobs of an earlier run again, as a new run; the exit code says how they ended.

    It is 0, and nothing is run, if no job of the run was selected.
    """
    from .....schemas.specs.check import load_spec
    from ...specification_run import carry_out, settings_of

    report = output_file(arguments.report, "--report")
    settings = settings_of(arguments)
    record = read_record(settings.home / "runs", arguments.run)

    from .....tasks.inspection.reruns import Selection, plan_rerun
    from .....tasks.nights.wanted_runs import WantedRun
    from .....tasks.service.service import Service

    selection = Selection(arguments.failed, tuple(arguments.job), tuple(arguments.world))
    rerun = plan_rerun(record, selection, Service.open(settings), arguments.timeout_s)
    if rerun is None:
        sys.stdout.write(f"nothing to run again: no job of the run {record.run_id} is {selection.words}\n")
        return 0
    # The run keeps the text; no file of the user's has it.
    spec = load_spec(rerun.spec_text, f"rerun of {record.run_id}")
    command = again(arguments, record.run_id)
    wanted = WantedRun(spec, record.spec_path, command, rerun_of=rerun.rerun_of)
    return carry_out(wanted, settings, arguments, report=report)


def again(arguments: argparse.Namespace, run_id: str) -> list[str]:
    """Returns the command line that repeats the same rerun, also when another run is the latest."""
    command = ["robomaker", "rerun", run_id, *(["--failed"] if arguments.failed else [])]
    return command + given_options(arguments, "job", "world", "timeout_s", "backend", "report")
