"""Exit codes of the command line; `robomaker --help` and `docs/commands.md` list them.

Which becomes which is said by errors in `schemas.wire.errors`, by ends of runs and by answers of `compare` and
`run --against` in `schemas.reports.run_exit_codes`, and by those of `verify` in `schemas.runs.verification`.
"""

from collections.abc import Mapping
from types import MappingProxyType

OK = 0
"""Exit code for success; of `verify`: bit-identical; of `compare` and `run --against`: better."""

VERDICT_FAILED = 1
"""Exit code for a verdict FAIL; of `verify`: the runs differ; of `compare` and `run --against`: worse."""

BAD_USAGE = 2
"""Exit code for invalid arguments, an invalid specification or invalid settings; nothing was run."""

BROKE = 3
"""Something broke: a crash, the object store, a world that cannot be generated; a replay that cannot be compared."""

CANCELED = 4
TIMED_OUT = 5

NO_DIFFERENCE = 6
"""Exit code of `compare` and `run --against` if no difference is shown."""

NOT_COMPARABLE = 7
"""Exit code of `compare` and `run --against` if the runs cannot be compared."""

INTERRUPTED = 130
"""Exit code after Ctrl-C; after SIGTERM and SIGHUP it is 128 plus the signal's number, as the process ends by the
signal itself.
"""

PIPE_CLOSED = 141
"""Exit code if the program that read the output has closed the pipe; shells report the same for SIGPIPE."""

IN_WORDS: Mapping[int, str] = MappingProxyType(
    {
        OK: "all well",
        VERDICT_FAILED: "a simulation's verdict is fail",
        BAD_USAGE: "bad usage, specification or settings",
        BROKE: "something broke",
        CANCELED: "canceled",
        TIMED_OUT: "timed out",
        NO_DIFFERENCE: "no difference is shown",
        NOT_COMPARABLE: "the runs cannot be compared",
    }
)
"""Descriptions of the exit codes of runs; `run_states.meaning_of` describes that of one run, which may answer a
question.
"""
