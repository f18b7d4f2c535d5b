"""Entry point of the `robomaker` command: runs the words of a command line, returns the exit code."""

import gc
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress

from ...schemas import exit_codes
from .grammar import build_parser

_WITHOUT_SETTINGS = ("sdk-model", "completion")
"""Commands that shells run at each start: importing the settings, with pydantic, would double their time."""

_OBJECTS_UNTIL_COLLECTION = 10_000
"""New objects after which Python looks for rubbish, by default 700. What a command imports stays, and looking through
it hundreds of times took 0.1 to 0.2 s of CPU time of a `run`; more objects than these save no more.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the `robomaker` command line, and returns the exit code.

    Args:
        arguments: Words after the program's name; absent: those the program was started with.

    Returns:
        The exit code. Wrong usage ends the program with 2 at once.
    """
    if arguments is None:
        gc.set_threshold(_OBJECTS_UNTIL_COLLECTION)
    words = sys.argv[1:] if arguments is None else list(arguments)
    # Prefect sends nothing anywhere, nor prints a notice about it when it is imported, unless the user says so.
    os.environ.setdefault("DO_NOT_TRACK", "1")
    try:
        code = _executed(words)
        sys.stdout.flush()
    except BrokenPipeError:
        # Python would complain when it flushes standard output at the end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return exit_codes.PIPE_CLOSED
    return code


def _executed(words: Sequence[str]) -> int:
    """Executes the command, prints errors, and returns the exit code.

    Raises:
        BrokenPipeError: The reader of standard output or standard error has closed it.
    """
    try:
        return _execute(words)
    except KeyboardInterrupt as interruption:
        return _interrupted(interruption)
    except BrokenPipeError:
        raise
    except Exception as error:
        return _report(error, debug="--debug" in words or bool(os.environ.get("ROBOMAKER_DEBUG")))


def _interrupted(interruption: KeyboardInterrupt) -> int:
    """Prints that the command was interrupted, and returns the exit code of an interruption by Ctrl-C.

    After another signal it does not return: the process ends by that signal.
    """
    with suppress(OSError):  # the terminal may be gone
        sys.stderr.write("\nrobomaker: interrupted\n")
        sys.stderr.flush()
        sys.stdout.flush()
    number = getattr(interruption, "signal_number", signal.SIGINT)
    if number != signal.SIGINT:
        from .signals import die_of

        die_of(number)
    return exit_codes.INTERRUPTED


def _execute(words: Sequence[str]) -> int:
    parser = build_parser()
    if "_ARGCOMPLETE" in os.environ:
        from .completion import complete

        complete(parser)
    chosen = parser.parse_args(words)
    if chosen.version:
        return _print_version()
    if chosen.command is None:
        parser.print_help(sys.stderr)
        return 2
    if chosen.command not in _WITHOUT_SETTINGS:
        _warn_of_misspelt_settings()
    code: int = chosen.execute(chosen)
    return code


def _warn_of_misspelt_settings() -> None:
    """Prints on standard error each environment variable that resembles a setting and is none, as it has no effect."""
    from ...schemas.settings import misspelt_settings

    for name, setting in misspelt_settings(os.environ).items():
        sys.stderr.write(f"robomaker: warning: {name} is not a setting, and is ignored; did you mean {setting}?\n")


def _report(error: Exception, *, debug: bool) -> int:
    """Prints the error that ended a command on standard error, and returns the exit code that belongs to it.

    With `debug` the traceback is printed, too. An error that is none of the project's is called a defect.
    """
    from ...schemas.wire.errors import RobomakerError, ServiceError, SpecError

    if debug:
        traceback.print_exception(error)
    if isinstance(error, SpecError):
        from .output.answers import print_problems

        print_problems(error.problems, error.page)
    elif isinstance(error, ServiceError):
        sys.stderr.write(f"robomaker: {error.code}: {error}\n")
    elif isinstance(error, RobomakerError):
        sys.stderr.write(f"robomaker: {error}\n")
    elif isinstance(error, OSError) and error.filename:
        sys.stderr.write(f"robomaker: {error.filename}: {error.strerror}\n")
    else:
        sys.stderr.write(f"robomaker: {type(error).__name__}: {error}\n")
        if not debug:
            sys.stderr.write("This is a defect; run the same with --debug for the details.\n")
    return error.exit_code if isinstance(error, RobomakerError) else exit_codes.BROKE


def _print_version() -> int:
    import importlib.metadata

    sys.stdout.write(f"robomaker {importlib.metadata.version('prefect-robomaker')}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
