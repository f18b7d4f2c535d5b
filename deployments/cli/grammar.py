"""The grammar of the command line: commands, found without importing any of them, and their parsers."""

import argparse
import difflib
import importlib
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, Protocol, cast

from ...schemas.wings import WINGS

COMMANDS = Path(__file__).with_name("commands")
"""Folder with the groups of commands; folders `commands` of optional parts are one more group each."""

_DEPLOYMENTS = __name__.rpartition(".cli.")[0]

# What newcomers need stands first in the help, in the order they need it; everything else follows by name.
_GROUPS = ("specifications", "runs", "operations", "machine")
_FIRST = ("run", "validate", "plan", "report", "call")


class CommandModule(Protocol):
    """Interface of a module that implements one command of `robomaker`."""

    def declare(self, parser: argparse.ArgumentParser) -> None:
        """Adds the command's arguments to its parser."""

    def execute(self, arguments: argparse.Namespace) -> int:
        """Runs the command, and returns the exit code."""
        ...


class Command(NamedTuple):
    """A command of `robomaker`, found by its module.

    Not a dataclass: importing those takes longer than everything else here.
    """

    name: str
    path: Path
    """Path of a command's module, or of the folder with its subcommands."""

    module: str
    """Full name of a command's module or package."""

    summary: str
    """Line about a command for the list of commands."""

    description: str
    """First paragraph of the command's own help."""

    def load(self) -> CommandModule:
        """Imports and returns the module of a command of `robomaker`."""
        return cast("CommandModule", importlib.import_module(self.module))


class Group(NamedTuple):
    """Commands listed under one heading in the help; the group's name is no part of the command line."""

    heading: str
    commands: list[Command]


def find_groups() -> list[Group]:
    """Finds the groups of commands, in the help's order."""
    own = sorted(COMMANDS.iterdir(), key=lambda path: _place(path.name, _GROUPS))
    groups = {f"{_DEPLOYMENTS}.cli.commands.{path.name}": path for path in own}
    groups |= {f"{_DEPLOYMENTS}.{wing}.commands": Path(__file__).parents[1] / wing / "commands" for wing in WINGS}
    return [
        Group(_description(path / "__init__.py").partition("\n")[0].rstrip("."), find_commands(path, package))
        for package, path in groups.items()
        if (path / "__init__.py").is_file()
    ]


def find_commands(folder: Path, package: str) -> list[Command]:
    """Finds the commands in a folder of modules, in the help's order.

    Args:
        folder: The folder.
        package: Full name of the package.
    """
    return sorted(_commands(folder, package), key=lambda command: _place(command.name, _FIRST))


def _commands(folder: Path, package: str) -> Iterator[Command]:
    for path in folder.iterdir():
        if path.is_dir() and (path / "__init__.py").is_file():
            yield _command(path, path / "__init__.py", package)
        elif path.suffix == ".py" and path.stem != "__init__":
            yield _command(path, path, package)


def _command(path: Path, source: Path, package: str) -> Command:
    description = _description(source)
    first = description.partition("\n")[0].rstrip(".")
    module, summary = f"{package}.{path.stem}", first[0].lower() + first[1:]
    return Command(path.stem.replace("_", "-"), path, module, summary, description)


def _description(source: Path) -> str:
    # Read, not imported: a list of commands needs the code of none. Style checks see to it that a module begins so.
    return source.read_text(encoding="utf-8").split('"""', 2)[1].rstrip()


def _place(name: str, first: tuple[str, ...]) -> tuple[int, str]:
    return first.index(name) if name in first else len(first), name


EPILOGUE = """\
exit codes:
  0    all well
  1    a simulation's verdict is fail
  2    bad usage, specification or settings
  3    something broke: a crash, the object store, a world that cannot be generated
  4    canceled
  5    timed out
  6    compare, run --against: no difference shown
  7    compare, run --against: not comparable
  130  interrupted with Ctrl-C

The answer goes to standard output, everything else to standard error. NO_COLOR switches colors
off, CI=true animation. Settings are environment variables: ROBOMAKER_HOME, ROBOMAKER_OBJECT_STORE,
ROBOMAKER_CATALOG_URL, ROBOMAKER_BUCKET, ROBOMAKER_MAX_JOBS, PREFECT_API_URL and more (see docs/settings.md).

first steps:
  robomaker doctor                                     what works on this machine
  robomaker run deployments/specs/quickstart.yaml      four small simulations and a report
  robomaker report latest                              how it went, and why jobs failed
  robomaker history                                    all runs
  robomaker call ListSimulationJobs                    the newest jobs; ListWorlds: the newest worlds"""


_RUNS, _REASONS = "runs are listed by `robomaker history`", "reasons of failures are in `robomaker report RUN`"
_LOGS = "logs are in the folder `logs` of a job's outputs, which `robomaker report RUN` links"
_WORLDS = "`robomaker call ListWorlds` lists worlds"
_STOP = "Ctrl-C ends a run; `robomaker call CancelSimulationJob` or `CancelSimulationJobBatch` a job or batch"
_REMOVED = "`robomaker gc` removes runs; `robomaker call DeleteWorldTemplate` and its like what operations made"
TRIED_WORDS = {
    **dict.fromkeys(("why", "explain", "failures", "reasons", "cause", "causes"), _REASONS),
    **dict.fromkeys(("list", "ls", "runs", "status", "ps"), _RUNS),
    **dict.fromkeys(("job", "jobs"), f"`robomaker call ListSimulationJobs` lists jobs; {_RUNS}"),
    **dict.fromkeys(("logs", "log", "tail"), _LOGS),
    **dict.fromkeys(("stop", "cancel", "kill", "abort"), _STOP),
    **dict.fromkeys(("delete", "remove", "rm", "clean", "prune"), _REMOVED),
    **dict.fromkeys(
        ("show", "view", "open"), "`robomaker report RUN` shows a run, `robomaker world show WORLD` a world"
    ),
    **dict.fromkeys(("diff",), "two runs are compared by `robomaker compare A B`"),
    **dict.fromkeys(("start", "simulate", "test"), "a specification is run by `robomaker run SPEC`"),
    **dict.fromkeys(("check", "lint"), "specifications are checked by `robomaker validate SPEC`"),
    **dict.fromkeys(("retry", "resume"), "jobs are run again by `robomaker rerun RUN`"),
    **dict.fromkeys(("replay", "reproduce", "debug"), "a simulation is run again by `robomaker repro JOB`"),
    **dict.fromkeys(("init", "new"), "`robomaker run deployments/specs/quickstart.yaml` is a first specification"),
    **dict.fromkeys(("console", "ui", "dashboard"), "the console is a page of `robomaker serve`"),
    **dict.fromkeys(("worlds", "generate"), f"{_WORLDS}; specifications make them"),
    **dict.fromkeys(("version",), "`robomaker --version` prints it"),
    **dict.fromkeys(("help",), "`robomaker --help` lists the commands"),
}
"""Words that users try and that are no commands, each with the command that answers."""
_TRIED_ACTIONS = {("world", word): _WORLDS for word in ("list", "ls")}
"""Words that users try after a command, each with the command that answers."""


class Parser(argparse.ArgumentParser):
    """Command line parser that suggests the nearest correct word on an error."""

    def parse_known_args(  # pyright: ignore[reportIncompatibleMethodOverride] - argparse overloads it
        self, args: Iterable[str] | None = None, namespace: Any = None
    ) -> Any:
        """Parses command line arguments; ends the program with exit code 2 if one is unknown or empty."""
        chosen, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}{self._advice(unknown[0])}")
        self._refuse_empty_words(chosen)
        return chosen, unknown

    def _refuse_empty_words(self, chosen: argparse.Namespace) -> None:
        """Ends the program if a positional argument is empty, as `"$RUN"` is where the shell has no such variable."""
        for action in self._actions:
            given = getattr(chosen, action.dest, None)
            if not action.option_strings and "" in (given if isinstance(given, list) else [given]):
                self.error(
                    f"{action.metavar or action.dest.upper()} is empty; it may be a shell variable that is not set"
                )

    def _advice(self, word: str) -> str:
        near = difflib.get_close_matches(word.partition("=")[0], self._option_string_actions, n=1)
        return f"; did you mean '{near[0]}'?" if near else ""

    def error(self, message: str) -> NoReturn:
        """Ends the program with exit code 2, and prints the error with a suggestion."""
        if match := re.fullmatch(r"argument \S+: invalid choice: '(.*)' \(choose from (.*)\)", message, re.DOTALL):
            choices = re.findall(r"[\w-]+", match[2])
            near = difflib.get_close_matches(match[1], choices, n=1)
            command = self.prog.rpartition(" ")[2]
            is_command = message.startswith("argument COMMAND:")
            known = TRIED_WORDS.get(match[1].lower()) if is_command else _TRIED_ACTIONS.get((command, match[1].lower()))
            if known:
                self.exit(2, f"{self.prog}: there is no {match[1]!r}; {known}\n")
            advice = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(choices)}"
            message = f"there is no {match[1]!r}; {advice}"
        self.exit(2, f"{self.prog}: {message}\n{self.format_usage()}")


class CommandParser(Parser):
    """Parser of one command, whose module is imported only when the command is chosen.

    Args:
        command: The command; the rest is argparse's.
    """

    def __init__(self, command: Command, **options: Any) -> None:
        super().__init__(formatter_class=_Formatter, description=command.description, **options)
        self._command = command
        self._is_declared = False
        _add_debug(self)

    def declare(self) -> None:
        """Imports the command's module and adds its arguments or its subcommands; a second call does nothing."""
        if self._is_declared:
            return
        self._is_declared = True
        if self._command.path.is_dir():
            actions = self.add_subparsers(
                parser_class=CommandParser, dest="action", metavar="ACTION", title="actions", required=True
            )
            _add_commands(actions, find_commands(self._command.path, self._command.module))
        else:
            module = self._command.load()
            module.declare(self)
            self.set_defaults(execute=module.execute)

    def parse_known_args(self, args: Iterable[str] | None = None, namespace: Any = None) -> Any:
        """Parses the command's arguments; the result's `execute` runs the command."""
        self.declare()
        return super().parse_known_args(args, namespace)


def build_parser() -> Parser:
    """Makes the command line parser of `robomaker`."""
    parser = Parser(
        prog="robomaker",
        description="Generate worlds, simulate robots in them, learn what broke.",
        epilog=EPILOGUE,
        formatter_class=_Formatter,
    )
    _add_debug(parser)
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands: Any = parser.add_subparsers(
        action=_GroupedCommands, parser_class=CommandParser, dest="command", metavar="COMMAND", title="commands"
    )
    for group in find_groups():
        commands.add_group(group)
    return parser


def _add_debug(parser: Parser) -> None:
    # Suppressed, so that a command does not take back what stood before its name.
    parser.add_argument(
        "--debug", action="store_true", default=argparse.SUPPRESS, help="show tracebacks; also ROBOMAKER_DEBUG=1"
    )


def _add_commands(commands: "argparse._SubParsersAction[Any]", found: Iterable[Command]) -> None:
    for command in found:
        commands.add_parser(command.name, help=command.summary, command=command)


class _GroupedCommands(argparse._SubParsersAction):  # pyright: ignore[reportMissingTypeArgument] - only its stub has some
    """argparse action whose commands the help lists under headings."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.headings: dict[str, str] = {}
        """The heading above a command, by the command's name."""

    def add_group(self, group: Group) -> None:
        """Adds the commands of a group to the command line's help, under the group's heading."""
        self.headings[group.commands[0].name] = group.heading
        _add_commands(self, group.commands)


class _Formatter(argparse.RawDescriptionHelpFormatter):
    """Help formatter that leaves out the line of the command list itself, and adds headings."""

    def add_argument(self, action: argparse.Action) -> None:
        """Reserves space in the help for the longest command name."""
        super().add_argument(action)
        if isinstance(action, argparse._SubParsersAction):
            longest = max(map(len, action.choices))
            self._action_max_length = max(self._action_max_length, longest + 2 * self._indent_increment)

    def _format_action(self, action: argparse.Action) -> str:
        if isinstance(action, argparse._SubParsersAction):
            lines = [self._command(action, each) for each in self._iter_indented_subactions(action)]
            return self._join_parts(lines).removeprefix("\n")
        return super()._format_action(action)

    def _command(self, commands: "argparse._SubParsersAction[Any]", command: argparse.Action) -> str:
        line = self._format_action(command)
        if isinstance(commands, _GroupedCommands) and (heading := commands.headings.get(command.dest)):
            return f"\n  {heading}:\n{line}"
        return line
