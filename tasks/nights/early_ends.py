"""Early end of a run that is compared with an earlier run: its jobs are cancelled once the question is decided."""

import logging
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from ...schemas.reports.live_comparison import Against, AgainstAnswer, in_words
from ...schemas.reports.progress import Note, ProgressListener
from ...schemas.reports.run_record import StepRecord
from ...schemas.specs.specification import CheckedSpec
from ...schemas.wire.errors import ConfigurationError, ServiceUnavailableException
from ..inspection.runs_beside import DRIVES, RunBeside, earlier_run, with_skipped
from ..service.service import Service
from .open_runs import OpenRun

LOOK_S = 1.0
"""Interval between two checks whether jobs have ended, in seconds: a job takes longer, and a check only counts them."""

_logger = logging.getLogger(__name__)


class EarlyEnd:
    """Compares a run's jobs with those of an earlier run, and cancels the rest once the comparison is decided.

    Args:
        asked: The question.
        spec: The specification of the run.
        service: The service, with its catalog and object store.
        listener: Called when it is decided.
        open_run: The run, if another process began it, which may have decided it.

    Raises:
        ConfigurationError: The earlier run cannot be compared with; not where another process began the run.
    """

    def __init__(
        self,
        asked: Against,
        spec: CheckedSpec,
        service: Service,
        listener: ProgressListener,
        open_run: OpenRun | None,
    ) -> None:
        self._question, self._service, self._listener = asked, service, listener
        self._decided = open_run.order.decided if open_run is not None else None
        self._problem = ""
        self._beside: RunBeside | None = None
        try:
            before = earlier_run(asked, service.settings.home / "runs", spec)
            self._beside = RunBeside(asked, before, spec.order, service)
        except ConfigurationError as error:
            if open_run is None or not open_run.order.interruptions:
                raise
            self._problem = str(error)  # the night is worth more than the answer
            if self._decided is None:
                listener(Note(f"this run is not compared any more: {error}"))

    @property
    def is_decided(self) -> bool:
        """Whether the comparison with the earlier run is decided, so that no more jobs are needed."""
        return self._decided is not None

    @contextmanager
    def watching(self, steps: Sequence[StepRecord], now: StepRecord, run: OpenRun | None) -> Iterator[None]:
        """Watches a step inside the `with` block.

        Args:
            steps: The steps before it.
            now: The step, with what it made.
            run: Keeps the answer, for a process that finishes the run.
        """
        if (self._beside is None and self._decided is None) or now.operation not in DRIVES:
            yield
            return
        over = threading.Event()
        begun, beside = [*steps, now], self._beside
        thread = threading.Thread(target=lambda: self._watch(begun, beside, run, over), name="early end", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()

    def answer(self, steps: Sequence[StepRecord]) -> AgainstAnswer:
        """Returns at the run's end whether it is better or worse than the earlier one, and how much an early end saved.

        An answer given while the run ran stays, even if the earlier run was deleted since. If the comparison fails, the
        answer is `not comparable`, with the reason.

        Args:
            steps: Results of the run's steps.

        Raises:
            ServiceUnavailableException: The catalog does not answer.
        """
        if self._beside is None:
            return with_skipped(self._decided, steps) if self._decided else self._unknown(self._problem)
        try:
            if self._decided is not None:
                return self._beside.with_saved(self._decided, steps)
            return self._beside.answer(steps, is_over=True) or self._unknown("nothing was looked at")
        except ServiceUnavailableException:
            raise
        except Exception as error:  # the report and the record are written all the same
            _logger.exception("the answer is not known, or not what it saved")
            if self._decided is not None:
                return with_skipped(self._decided, steps)
            return self._unknown(f"{type(error).__name__}: {error}")

    def _unknown(self, why: str) -> AgainstAnswer:
        asked = self._question
        return AgainstAnswer(
            run_id=asked.run_id, alpha=asked.alpha, margin=asked.margin, answer="not comparable", why=why, pairs=0,
            planned=0,
        )  # fmt: skip

    def _watch(
        self, begun: Sequence[StepRecord], beside: RunBeside | None, run: OpenRun | None, over: threading.Event
    ) -> None:
        seen, has_cancelled = -1, False
        while not over.wait(LOOK_S if seen >= 0 else 0.0):
            try:
                if self._decided is None and beside and (count := beside.ended_count(begun)) != seen:
                    self._decided, seen = beside.answer(begun), count
                    if self._decided is not None:
                        self._note_decided(self._decided, run)
                if self._decided is not None and not has_cancelled:
                    self._service.catalog.request_cancel(begun[-1].arn or "")
                    has_cancelled = True
            except ServiceUnavailableException:
                seen = max(seen, 0)  # the next look sees what this one missed
            except Exception as error:
                _logger.exception("the run is not watched any more")
                self._listener(Note(f"this run does not stop early: {type(error).__name__}: {error}"))
                return

    def _note_decided(self, answer: AgainstAnswer, run: OpenRun | None) -> None:
        """Stores the answer before jobs are cancelled, so that no process takes the cancelled jobs for lost ones.

        Tells the listener of it; that it could not be stored is only logged.
        """
        try:
            if run is not None:
                run.change(decided=answer)
        except OSError as error:
            _logger.warning("the answer cannot be kept for another process: %s", error)
        self._listener(Note(f"{in_words(answer)}; what still runs is cancelled"))
