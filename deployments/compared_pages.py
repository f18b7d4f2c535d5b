"""Pages that show two runs, or two cells of an axis of one run, side by side: of the console, and as a file."""

import base64
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote, unquote

from ..schemas.reports.changes import ChangedInput
from ..schemas.reports.comparison import Comparison
from ..schemas.reports.report import ReportedFile
from ..schemas.reports.run_record import JobRecord, RunRecord
from ..schemas.runs.trial_rows import TrialsSummary
from ..schemas.wire.errors import ConfigurationError
from ..tasks.comparison.compared_runs import NightRun, name_of
from ..tasks.comparison.pairing import Pair, pair_jobs
from ..tasks.comparison.side_by_side import StepAxis, by_change, has_changed, pair_cells, requirements_beside, was_run
from ..tasks.files.whole_files import replaced
from ..tasks.inspection.job_outputs import drive_of
from ..tasks.reporting import (
    ComparedSide,
    ComparisonPage,
    Drive,
    PairLine,
    PairPainter,
    SideTrials,
    TrialsBeside,
    change_in_words,
    outcomes,
    trials_beside,
)
from ..tasks.service.service import Service

MOST_CARDS = 60
"""Pairs that a file shows with plans and videos: with two paths of 600 points each it has about 2 MB then."""
_MOST_EMBEDDED_BYTES, _MOST_EMBEDDED_TOGETHER_BYTES = 3_000_000, 24_000_000
"""Size of a video up to which it is put into a file, and of all of them: with a third more as text, mail takes it."""
_MOST_TOLD = 2
"""Parameters that a legend names; the head of the page has all differences."""


@dataclass(frozen=True)
class Sides:
    """Two runs, or two cells of an axis, with their pairs: those whose jobs ended differently come first."""

    name: str
    before: ComparedSide
    after: ComparedSide
    pairs: Sequence[Pair]
    comparison: Comparison | None
    differences: Sequence[str]

    @classmethod
    def of_runs(cls, before: RunRecord, after: RunRecord, comparison: Comparison | None = None) -> "Sides":
        """Puts two runs side by side.

        Args:
            before: First run, A.
            after: Second run, B.
            comparison: Their comparison; None: it is made, with an error probability of 5 %.
        """
        # Imported late: tests of statistics need scipy, 0.2 s of CPU time when `serve` starts.
        from ..tasks.comparison.better_or_worse import compare

        pairing = pair_jobs(before.jobs, after.jobs)
        comparison = comparison or compare(*map(NightRun.of, (before, after)))
        changed = comparison.changed
        titles = [_title(run, changed, is_first) for run, is_first in ((before, True), (after, False))]
        if titles[0] == titles[1]:
            titles = [before.run_id, after.run_id]
        return cls(
            name=after.name,
            before=ComparedSide("A", titles[0], before.run_id, pairing.only_before),
            after=ComparedSide("B", titles[1], after.run_id, pairing.only_after),
            pairs=by_change(pairing.pairs),
            comparison=comparison,
            differences=[change_in_words(each) for each in changed],
        )

    @classmethod
    def of_cells(cls, record: RunRecord, axis: StepAxis, first: int, other: int) -> "Sides":
        """Puts the jobs of two values of an axis side by side.

        Args:
            record: The run.
            axis: The axis.
            first: Index of the value that is A.
            other: Index of the value that is B.
        """
        pairing = pair_cells(record.jobs, axis, axis.values[first], axis.values[other])
        titles = [f"{axis.name} {axis.titles[index]}" for index in (first, other)]
        return cls(
            name=record.name,
            before=ComparedSide("A", titles[0], record.run_id, pairing.only_before),
            after=ComparedSide("B", titles[1], record.run_id, pairing.only_after),
            pairs=by_change(pairing.pairs),
            comparison=None,
            differences=[f"{axis.name} of {axis.step}: {axis.titles[first]} → {axis.titles[other]}"],
        )


def compared_page(
    sides: Sides,
    service: Service,
    video_link: Callable[[JobRecord, ReportedFile], str],
    *,
    first: int = 1,
    most: int = MOST_CARDS,
    is_seen: Callable[[JobRecord], bool] = lambda _: True,
    chosen: Mapping[int, int] | None = None,
    **more: object,
) -> ComparisonPage:
    """Makes the values of the page, with the cards of some pairs.

    Args:
        sides: Both sides.
        service: Service that stores outputs and worlds.
        video_link: Function that returns the URL of a job's video; empty where browsers cannot open it.
        first: Number of the first pair that has a card, from 1.
        most: Maximum number of cards.
        is_seen: Function that returns whether the visitor may see a job.
        chosen: Numbers of the trials that are shown, by number of the pair; of others the first that differs.
        **more: Further values of the page.
    """
    painter = PairPainter(video_link)
    shown = sides.pairs[first - 1 : first - 1 + most]
    cards = []
    for number, pair in enumerate(shown, start=first):
        drives = _drive(pair.before, service, is_seen), _drive(pair.after, service, is_seen)
        before, after = (SideTrials(each.result, each.trials, each.first_seed) for each in drives)
        trials = trials_beside((before, after))
        shown = None
        if trials is not None:
            wanted = (chosen or {}).get(number, trials.first)
            shown = wanted if wanted in trials.numbers else trials.first
            drives = _drives_of_trial(pair, drives, trials, shown, service)
        asked = (drives[0].asked, drives[1].asked) if all(drive.asked for drive in drives) else None
        rows = requirements_beside(pair, asked)
        cards.append(
            painter.card(number, (pair.before, pair.after), name_of(pair.after).title, rows, drives, trials, shown)
        )
    return ComparisonPage(
        name=sides.name,
        before=sides.before,
        after=sides.after,
        comparison=sides.comparison,
        differences=sides.differences,
        pairs=len(sides.pairs),
        changed=sum(map(has_changed, sides.pairs)),
        not_run=sum(not was_run(pair) for pair in sides.pairs),
        first=first,
        cards=cards,
        worlds=list(painter.worlds.values()),
        **more,  # type: ignore[arg-type] - they are those of the page
    )


def compared_file(sides: Sides, service: Service, path: Path) -> ComparisonPage:
    """Makes the values of a page that is a file: cards of the first pairs, and rows of the others.

    Large videos are copied into a folder beside the file; it can be sent to somebody, with that folder if there is one.

    Args:
        sides: Both sides.
        service: Service that stores outputs and worlds.
        path: Path of the file.

    Raises:
        ConfigurationError: The folder of videos cannot be written.
    """
    lines = [PairLine(name_of(pair.after).title, (pair.before, pair.after)) for pair in sides.pairs[MOST_CARDS:]]
    videos = _Videos(path)
    page = compared_page(sides, service, videos.link, lines=lines)
    return replace(page, video_folder=videos.folder.name if videos.has_copied else "")


class _Videos:
    """Videos of a page that is a file: small ones in it, others in a folder beside it.

    Args:
        page: Path of the file.
    """

    def __init__(self, page: Path) -> None:
        self.folder = page.with_name(f"{page.stem}-videos")
        self.has_copied = False
        self._embedded_bytes = 0

    def link(self, job: JobRecord, file: ReportedFile) -> str:
        """Returns the URL of a video; one in another object store, or that is gone, has none.

        Raises:
            ConfigurationError: The folder of videos cannot be written.
        """
        if not file.uri.startswith("file:///"):
            return ""
        video = Path(unquote(file.uri.removeprefix("file://")))
        try:
            size_bytes = video.stat().st_size
            together = self._embedded_bytes + size_bytes
            if size_bytes <= _MOST_EMBEDDED_BYTES and together <= _MOST_EMBEDDED_TOGETHER_BYTES:
                self._embedded_bytes = together
                return f"data:video/mp4;base64,{base64.b64encode(video.read_bytes()).decode()}"
            opened = video.open("rb")
        except OSError:
            return ""
        with opened:
            return self._copied(opened, f"{job.label}-{file.name.replace('/', '-')}")

    def _copied(self, video: BinaryIO, name: str) -> str:
        path = self.folder / name
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with replaced(path) as part, part.open("xb") as file:
                shutil.copyfileobj(video, file)
        except OSError as error:
            why = os.strerror(error.errno).lower() if error.errno else str(error)
            raise ConfigurationError(
                f"--report: the page's folder of videos {self.folder} cannot be written: {why}; a page in a folder "
                "where you may write would be right"
            ) from error
        self.has_copied = True
        return quote(f"{self.folder.name}/{name}")


def _drive(job: JobRecord, service: Service, is_seen: Callable[[JobRecord], bool]) -> Drive:
    if not is_seen(job):
        return Drive(trouble="This job is not shown to your access key.")
    return drive_of(job, service)


def _drives_of_trial(
    pair: Pair, drives: tuple[Drive, Drive], trials: TrialsBeside, shown: int, service: Service
) -> tuple[Drive, Drive]:
    """Returns what a trial left of its drive in both jobs; a job's own where the job left no result of its trials."""
    found: list[Drive] = []
    numbers = (trials.before.get(shown), shown)
    for job, drive, number, end in zip((pair.before, pair.after), drives, numbers, trials.told[shown], strict=True):
        own = drive
        if TrialsSummary.of(drive.result) is not None:
            own = replace(drive, result=None, files=()) if number is None else drive_of(job, service, number)
        found.append(replace(own, trial_title=trials.titles[shown], trial_end=end))
    return found[0], found[1]


def _title(run: RunRecord, changed: Sequence[ChangedInput], is_first: bool) -> str:
    """Returns the name of a run in legends: when it began, and parameters or commits that tell it from the other."""
    values = [
        f"{each.name}={'none' if (value := each.before if is_first else each.after) is None else value}"
        for each in changed
        if each.what == "parameter"
    ]
    commits = [each.before if is_first else each.after for each in changed if each.what == "commit"]
    told = values[:_MOST_TOLD] or [f"commit {commit[:8]}" for commit in commits if commit]
    return ", ".join([outcomes.minute(run.started_at), *told])
