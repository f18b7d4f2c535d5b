"""The command line's grammar.

argparse, because it starts in 0.04 s where nothing else does, also in containers that keep no byte code
(cyclopts, which Prefect brings along: 0.13 s, and 0.4 s there). Each command's code is imported when
it is chosen.
"""

import argparse
import difflib
import re
from collections.abc import Callable
from typing import NoReturn

EPILOGUE = """\
exit codes:
  0    all well
  1    a simulation's verdict is fail
  2    bad usage, specification or settings
  3    something broke: a crash, the object store, a world that cannot be generated
  4    canceled
  5    timed out
  130  interrupted with Ctrl-C

The answer goes to standard output, everything else to standard error. NO_COLOR switches colors
off, CI=true animation. Settings are environment variables: ROBOMAKER_HOME, ROBOMAKER_OBJECT_STORE,
ROBOMAKER_CATALOG_URL, ROBOMAKER_BUCKET, ROBOMAKER_MAX_JOBS, PREFECT_API_URL and more (see the README).

first steps:
  robomaker doctor                                     what works on this machine
  robomaker run deployments/specs/quickstart.yaml      four small simulations and a report"""


class Parser(argparse.ArgumentParser):
    """A parser that suggests what may have been meant."""

    more_help: Callable[[], str] | None = None
    """Makes what the help ends with, when somebody asks for help."""

    def format_help(self) -> str:
        """The help, with what only it needs."""
        if self.more_help is not None:
            self.epilog = self.more_help()
        return super().format_help()

    def error(self, message: str) -> NoReturn:
        """Ends the program with exit code 2 and what would be right."""
        if match := re.fullmatch(r"argument \S+: invalid choice: '(.*)' \(choose from (.*)\)", message, re.DOTALL):
            choices = re.findall(r"[\w-]+", match[2])
            near = difflib.get_close_matches(match[1], choices, n=1)
            advice = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(choices)}"
            message = f"there is no {match[1]!r}; {advice}"
        self.exit(2, f"{self.prog}: {message}\n{self.format_usage()}")


def build_parser() -> Parser:
    """Makes the parser of the `robomaker` command; `command` is the name of the chosen command, like its module."""
    shared = Parser(add_help=False)
    shared.add_argument(
        "--debug", action="store_true", default=argparse.SUPPRESS, help="show tracebacks; also ROBOMAKER_DEBUG=1"
    )
    parser = Parser(
        prog="robomaker",
        description="Generate worlds, simulate robots in them, learn what broke.",
        epilog=EPILOGUE,
        formatter_class=_Formatter,
        parents=[shared],
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands", parser_class=Parser)
    _add_spec_commands(commands, shared)
    _add_other_commands(commands, shared)
    return parser


# argparse has no public name for it.
_Commands = argparse._SubParsersAction


class _Formatter(argparse.RawDescriptionHelpFormatter):
    """Lists commands without a line for the list itself."""

    def add_argument(self, action: argparse.Action) -> None:
        """Leaves room for the longest command, which argparse forgets to indent."""
        super().add_argument(action)
        if isinstance(action, argparse._SubParsersAction):
            longest = max(map(len, action.choices))
            self._action_max_length = max(self._action_max_length, longest + 2 * self._indent_increment)

    def _format_action(self, action: argparse.Action) -> str:
        if isinstance(action, argparse._SubParsersAction):
            return self._join_parts([self._format_action(each) for each in self._iter_indented_subactions(action)])
        return super()._format_action(action)


def _command(commands: "_Commands[Parser]", shared: Parser, name: str, summary: str, more: str) -> Parser:
    return commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.\n\n{more}".rstrip(),
        formatter_class=_Formatter,
        parents=[shared],
    )


def _add_spec_commands(commands: "_Commands[Parser]", shared: Parser) -> None:
    run = _command(
        commands,
        shared,
        "run",
        "run a specification and report what came of it",
        "The exit code says how it ended; `robomaker --help` lists them.",
    )
    run.add_argument("spec", metavar="SPEC", help="specification, a YAML file")
    run.add_argument("--name", help="name of the run, in place of the specification's")
    run.add_argument("--seed", type=int, metavar="N", help="seed of worlds and simulations, in place of those in SPEC")
    run.add_argument("--report", metavar="PATH", help="put a copy of the report there")
    _add_output(run, ("text", "json"))
    _add_open(run, "show the report in a browser (by default only on a desktop's terminal)")

    validate = _command(
        commands,
        shared,
        "validate",
        "check specifications without running anything",
        "Every problem is printed as file:line:column: path: message.",
    )
    validate.add_argument("specs", metavar="SPEC", nargs="+", help="specification, a YAML file")
    _add_output(validate, ("text", "json"))

    plan = _command(
        commands, shared, "plan", "show the steps of a specification in the order they would run", "Runs nothing."
    )
    plan.add_argument("spec", metavar="SPEC", help="specification, a YAML file")
    _add_output(plan, ("text", "json"))


def _add_other_commands(commands: "_Commands[Parser]", shared: Parser) -> None:
    report = _command(commands, shared, "report", "write the report of a run again and print its path", "")
    report.add_argument("run", metavar="RUN", nargs="?", default="latest", help="id of a run, or latest (the default)")
    report.add_argument("--junit", metavar="FILE", help="write it as JUnit XML too, for CI systems")
    _add_output(report, ("text", "json"))
    _add_open(report, "show it in a browser")

    call = _command(
        commands,
        shared,
        "call",
        "call one operation, as an SDK would",
        "Takes the same input as the AWS CLI's --cli-input-json and --cli-input-yaml. Each operation with an\n"
        "example: docs/operations.md; its members: robomaker schema OPERATION.",
    )
    call.more_help = _operations_by_group
    call.add_argument("operation", metavar="OPERATION", help="operation: DescribeWorld, describe-world, …")
    call.add_argument(
        "--input", metavar="INPUT", default="{}", help="request: a file, JSON text, or - for standard input"
    )
    call.add_argument("--wait", action="store_true", help="carry a job to its end and print its final description")
    _add_output(call, ("json", "yaml"))

    _add_replay(commands, shared)
    perform = _command(commands, shared, "perform", "carry a stored job or batch to its end", "")
    perform.add_argument("arn", metavar="ARN", help="ARN of the job, as `call` printed it")
    _add_output(perform, ("json", "yaml"))

    schema = _command(
        commands, shared, "schema", "print the JSON Schema of specifications, or of an operation's request", ""
    )
    schema.add_argument("operation", metavar="OPERATION", nargs="?", help="an operation, such as CreateWorldTemplate")

    sdk_model = _command(
        commands,
        shared,
        "sdk-model",
        "print how boto3 and the AWS CLI find RoboMaker's service model",
        'eval "$(robomaker sdk-model)" makes those of one shell find it, --install those of this user.',
    )
    where = sdk_model.add_mutually_exclusive_group()
    where.add_argument("--install", action="store_true", help="copy it to ~/.aws/models, where they look anyway")
    where.add_argument("--uninstall", action="store_true", help="remove it from there")
    sdk_model.add_argument("--force", action="store_true", help="with --install: replace a model from elsewhere")
    _add_output(sdk_model, ("text", "json"))

    doctor = _command(commands, shared, "doctor", "say what works on this machine and what is missing", "")
    _add_output(doctor, ("text", "json"))

    _add_world(commands, shared)
    _add_serve(commands, shared)
    server = _command(
        commands, shared, "server", "start, stop or look at the local Prefect server", "start prints its API's URL."
    )
    server.add_argument("action", choices=("start", "stop", "status"))


def _add_world(commands: "_Commands[Parser]", shared: Parser) -> None:
    world = _command(commands, shared, "world", "look at generated worlds: show, view, sheet", "")
    actions = world.add_subparsers(dest="action", metavar="ACTION", title="actions", parser_class=Parser, required=True)

    show = _command(
        actions, shared, "show", "print a world's plan, what was proven of it, and which wishes it misses", ""
    )
    show.add_argument("world", metavar="WORLD", help="ARN of a world, or the folder of its bundle")
    show.add_argument(
        "--pictures", metavar="FOLDER", help="put the plan, a view from above and one from inside each room there"
    )
    _add_output(show, ("text", "json"))

    view = _command(
        actions,
        shared,
        "view",
        "show a world in 3D",
        "In MuJoCo's viewer where there is a display; otherwise as an HTML page of one file that any\n"
        "browser shows without a network, whose path is printed.",
    )
    view.add_argument("world", metavar="WORLD", help="ARN of a world, or the folder of its bundle")
    view.add_argument("--html", metavar="FILE", help="write the page there, whether there is a display or not")
    _add_open(view, "show the page in a browser, or do not (either makes a page)")

    sheet = _command(
        actions,
        shared,
        "sheet",
        "show all worlds of a generation job at a glance",
        "As a picture, sheet.png, and as a page, sheet.html; worlds with problems come first.",
    )
    sheet.add_argument("job", metavar="JOB", help="ARN of a world generation job")
    sheet.add_argument("--to", metavar="FOLDER", help="put both there (default: a folder in the data home)")
    _add_output(sheet, ("text", "json"))
    _add_open(sheet, "show the page in a browser (by default only on a desktop's terminal)")


def _add_replay(commands: "_Commands[Parser]", shared: Parser) -> None:
    run = "ARN or id of a simulation job, s3://BUCKET/PREFIX or a folder of outputs"
    verify = _command(
        commands,
        shared,
        "verify",
        "run a simulation again and say whether all states are the same",
        "Exit code 0: bit-identical; 1: diverged, when and in which joint; 3: not comparable, and why.\n"
        "Neither the job nor its outputs are touched.",
    )
    verify.add_argument("run", metavar="JOB", help=run)
    verify.add_argument(
        "--run-program",
        action="store_true",
        help="run a robot application that is a program again too, instead of what was recorded of it",
    )
    _add_output(verify, ("text", "json"))

    repro = _command(
        commands,
        shared,
        "repro",
        "put a simulation into a folder, run it again with video, and write a pytest file for it",
        "The folder has all that the run needs: world, application bundles, data, seed.",
    )
    repro.add_argument("run", metavar="JOB", help=run)
    repro.add_argument("--to", metavar="FOLDER", help="put it there (default: repro-<job id>)")
    repro.add_argument("--no-video", action="store_true", help="do not film the rerun")
    _add_output(repro, ("text", "json"))


def _operations_by_group() -> str:
    from ...schemas.operation_groups import OPERATION_GROUPS

    width = max(len(each.name) for group in OPERATION_GROUPS.values() for each in group)
    lines = ["operations:"]
    for title, group in OPERATION_GROUPS.items():
        lines += [f"  {title}", *(f"    {each.name:<{width}}  {each.description}" for each in group)]
    return "\n".join(lines)


def _add_serve(commands: "_Commands[Parser]", shared: Parser) -> None:
    serve = _command(
        commands,
        shared,
        "serve",
        "answer SDKs and the AWS CLI, and carry out the jobs they order",
        "Prints what to set so that clients find it. Access keys: ROBOMAKER_ACCESS_KEYS_FILE (docs/serving.md).",
    )
    serve.add_argument("--host", default="127.0.0.1", help="address to listen at (default: 127.0.0.1)")
    serve.add_argument("--port", type=int, default=8057, help="port to listen at; 0: any (default: 8057)")
    serve.add_argument(
        "--execute",
        choices=("here", "deployments", "none"),
        default="here",
        help="who carries jobs out: this program, Prefect's workers, or somebody else (default: here)",
    )
    serve.add_argument(
        "--max-jobs",
        type=int,
        metavar="N",
        help="simulation jobs at once, besides batches (default: number of CPUs)",
    )
    serve.add_argument("--log-requests", action="store_true", help="write a line for each request to standard error")
    _add_output(serve, ("text", "json"))


def _add_output(command: Parser, forms: tuple[str, ...]) -> None:
    command.add_argument(
        "-o", "--output", choices=forms, default=forms[0], help=f"form of the answer (default: {forms[0]})"
    )


def _add_open(command: Parser, text: str) -> None:
    command.add_argument("--open", action=argparse.BooleanOptionalAction, default=None, help=text)
