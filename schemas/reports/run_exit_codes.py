"""Exit codes of runs: by the end of a run, and by the answer of `compare` and `run --against`."""

from ..exit_codes import BROKE, CANCELED, NO_DIFFERENCE, NOT_COMPARABLE, OK, TIMED_OUT, VERDICT_FAILED
from .live_comparison import AgainstAnswer, Answer
from .run_record import RunState

EXIT_CODES: dict[RunState, int] = {
    "succeeded": OK,
    "failed": VERDICT_FAILED,
    "broken": BROKE,
    "canceled": CANCELED,
    "timed out": TIMED_OUT,
}
"""Exit code of the command line by the state of a run; see `exit_code_of` for runs with `--against`."""

ANSWER_EXIT_CODES: dict[Answer, int] = {
    "better": OK,
    "not worse": OK,
    "worse": VERDICT_FAILED,
    "no difference shown": NO_DIFFERENCE,
    "not comparable": NOT_COMPARABLE,
}
"""Exit codes of `robomaker compare` and of `robomaker run --against`, by the answer."""


def exit_code_of(state: RunState, against: AgainstAnswer | None) -> int:
    """Returns the exit code of a run.

    A run that was compared with an earlier run until its end has the exit code of the comparison's answer.

    Args:
        state: State of the finished run.
        against: Answer of the comparison; None: the run was not compared.
    """
    is_whole = state in ("succeeded", "failed")
    return ANSWER_EXIT_CODES[against.answer] if against is not None and is_whole else EXIT_CODES[state]
