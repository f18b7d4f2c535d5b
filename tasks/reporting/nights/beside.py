"""View model of two jobs side by side: both paths on one plan, both videos, and each requirement of both."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ....schemas.reports.comparison import RequirementBeside
from ....schemas.reports.report import ReportedFile
from ....schemas.reports.run_record import JobRecord
from ....schemas.runs.plan import Requirement, RunResult
from ....schemas.runs.trial_rows import TRIALS_FOLDER
from ....schemas.runs.trials import OF_ALL_TRIALS, Trials
from ....schemas.worlds.world import World
from .. import outcomes
from ..drawings import plan
from ..drawings.svg_writing import Frame
from ..drawings.two_paths import Goal, Miss, Way, draw_bare_paths, draw_two_paths
from ..outcomes import Outcome, why_no_video_of_trial
from ..worlds import read_world
from .changes import repro_command
from .trials_beside import NOT_RUN, TrialsBeside

_WHOLE, _CLIP = "video.mp4", "last-10s.mp4"

VideoLink = Callable[[JobRecord, ReportedFile], str]
"""Function that returns the URL of a job's video; empty where browsers cannot open it."""


@dataclass(frozen=True)
class Drive:
    """Everything that one job left of its drive, as far as it can be read."""

    result: RunResult | None = None
    files: Sequence[ReportedFile] = ()
    films_begin_s: Mapping[str, float] = field(default_factory=dict)
    """Simulated time in seconds of each video's first frame, by file name, as its `timeline.json` says."""
    asked: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Requirements of its request, by name."""
    video_policy: str = "none"
    world_json: Path | None = None
    """Description of the world that is stored for it; `None`: it drove in none, or that is gone."""
    world_content: str = ""
    """Digest of that world's content."""
    trial: int | None = None
    """Number of the trial whose result and videos these are; `None`: they are the job's own."""
    folder: str = ""
    """Folder of the trial's files within the job's outputs, with a slash; empty for the job itself."""
    trials: Trials | None = None
    """Trials that the job's request orders; `None`: it has none."""
    first_seed: int | None = None
    """Seed of the job, and of its first trial; `None`: it is not known."""
    trial_title: str = ""
    """Name of the trial: `friction 0.4 (trial 17)`; empty for the job itself."""
    trial_end: str = ""
    """End of the trial in words, `passed`; empty for the job itself."""
    trouble: str = ""
    """Reason why the job or its world cannot be read, as a sentence; empty: they can, or there is no world."""


@dataclass(frozen=True)
class DrawnWorld:
    """A world of the page, of which walls and furniture are drawn once."""

    content: World | None
    note: str
    fixtures: str
    """Id of the SVG group with walls and furniture."""
    drawing: Markup | None
    """That group; `None`: the world cannot be drawn."""


@dataclass(frozen=True)
class Film:
    """A job's video, and the simulated time at which it begins."""

    link: str
    name: str
    begins_s: float | None
    """Simulated time of its first frame, in seconds; `None`: it is not recorded, and the video does not follow."""

    @property
    def is_embedded(self) -> bool:
        """Whether the page itself has the video."""
        return self.link.startswith("data:")


@dataclass(frozen=True)
class SideView:
    """One of the two jobs of a card."""

    letter: str
    job: JobRecord
    outcome: Outcome
    reason: str
    """Reason why it broke or was not judged, in one line; empty: it was judged."""
    film: Film | None
    no_film: str
    """Reason why there is no video, as a sentence; empty: there is one."""
    first_miss: str
    """The requirement that it missed first, and where, in words; of a job with trials, how many did not pass."""

    @property
    def not_run(self) -> bool:
        """Whether the job came to no end of its own: its run stopped early, or it was canceled."""
        return self.outcome in (Outcome.CANCELED, Outcome.UNFINISHED)


@dataclass(frozen=True)
class RowView:
    """A row of the table of requirements."""

    beside: RequirementBeside
    before: tuple[str, str]
    """Key of the badge and words of the first job's outcome: `passed`, `met`."""
    after: tuple[str, str]


@dataclass(frozen=True)
class PairView:
    """A card with two jobs side by side."""

    anchor: str
    number: int
    """Number of the pair on the page, from 1."""
    title: str
    before: SideView
    after: SideView
    has_changed: bool
    """Whether the two jobs ended differently."""
    rows: list[RowView]
    plan: Markup | None
    note: str
    """Reason why there is no plan, or no path on it; empty: there is."""
    of_trials: bool
    """Whether the jobs have trials: these decide, and neither a margin nor a single requirement."""
    end_s: float
    """Simulated time at which the longer of both ends, in seconds; 0: nothing can be played."""
    trials: TrialsBeside | None = None
    """Trials that can be chosen; `None`: the jobs have none, or recorded none."""
    trial: int | None = None
    """Number of the trial whose paths and videos are shown; `None`: those of the jobs are."""

    @property
    def sides(self) -> tuple[SideView, SideView]:
        """The two sides of a card, that of the first run's job first."""
        return self.before, self.after


@dataclass
class PairPainter:
    """Makes the cards of one page; each world is read and drawn once."""

    video_link: VideoLink
    worlds: dict[str, DrawnWorld] = field(default_factory=dict)
    """Worlds drawn so far, by the digest of their content."""

    def card(
        self,
        number: int,
        jobs: tuple[JobRecord, JobRecord],
        title: str,
        rows: Sequence[RequirementBeside],
        drives: tuple[Drive, Drive],
        trials: TrialsBeside | None = None,
        shown: int | None = None,
    ) -> PairView:
        """Makes the card of a pair.

        Args:
            number: Number of the pair on the page, from 1.
            jobs: Both jobs, the first one first.
            title: Name of the job.
            rows: The requirements of both.
            drives: Everything that the two jobs left, or one trial of each.
            trials: Trials that can be chosen; `None`: there are none.
            shown: Number of the trial that the drives are of; `None`: they are those of the jobs.
        """
        before, after = (self._side(letter, job, drive) for letter, job, drive in zip("AB", jobs, drives, strict=True))
        drawing, note = self._plan(jobs, drives, title)
        of_trials = any(_has_trials(job) for job in jobs)
        return PairView(
            anchor=f"pair-{number}",
            number=number,
            title=title,
            before=before,
            after=after,
            has_changed=before.outcome is not after.outcome and not before.not_run and not after.not_run,
            rows=[RowView(row, *(_outcome_of(each, of_trials) for each in (row.before, row.after))) for row in rows],
            of_trials=of_trials,
            trials=trials,
            trial=shown,
            plan=drawing,
            note=note,
            end_s=max((_end_of(drive.result) for drive in drives), default=0.0) if drawing or before.film or after.film
            else 0.0,
        )  # fmt: skip

    def _side(self, letter: str, job: JobRecord, drive: Drive) -> SideView:
        outcome = outcomes.classify(job.status, job.failure_code, job.verdict)
        film, no_film = self._film(job, drive, outcome)
        first = next(iter((job.failure_reason or "").strip().splitlines()), "")
        reason = (
            "" if outcome in (Outcome.PASSED, Outcome.FAILED) else ": ".join(filter(None, (job.failure_code, first)))
        )
        return SideView(letter, job, outcome, outcomes.plain(reason), film, no_film, _first_miss_in_words(job, outcome))

    def _film(self, job: JobRecord, drive: Drive, outcome: Outcome) -> tuple[Film | None, str]:
        files = {file.name: file for file in drive.files}
        name = next((name for name in (_WHOLE, _CLIP) if drive.folder + name in files), "")
        if not name:
            return None, drive.trouble or _why_no_video(drive, outcome)
        file = files[drive.folder + name]
        if not (link := self.video_link(job, file)):
            return None, f"Its video is not on this machine: {file.uri}"
        return Film(link, name, drive.films_begin_s.get(name)), ""

    def _plan(
        self, jobs: tuple[JobRecord, JobRecord], drives: tuple[Drive, Drive], title: str
    ) -> tuple[Markup | None, str]:
        """Draws both paths on the plan of the world that both jobs drove in, and returns the drawing with a remark.

        The drawing is `None`, and the remark says why, if neither has a path or their worlds differ. Without a
        generated world only the paths are drawn.
        """
        ways = [
            Way(
                letter,
                drive.result,
                _first_miss(job.requirements if drive.trial is None else drive.result.requirements),
            )
            for letter, job, drive in zip("AB", jobs, drives, strict=True)
            if drive.result is not None and drive.result.path
        ]
        if not ways:
            return None, _missing_paths(jobs, drives)
        content, why_not = same_world(*jobs)
        if why_not:
            return None, why_not
        goals = _goals(drives)
        words = f"Paths of A and B, {title}"
        missing = _missing_paths(jobs, drives)
        if content is None:
            drawing = draw_bare_paths(ways, goals, words)
            return drawing, f"The jobs drove in no generated world, so that there is no plan. {missing}".rstrip()
        drawn = self._world(content, drives)
        if drawn.content is None or drawn.drawing is None:
            return None, drawn.note
        frame = Frame.of_world(drawn.content)
        return draw_two_paths(drawn.content, frame, drawn.fixtures, ways, goals, f"{words}, on one plan"), missing

    def _world(self, content: str, drives: Sequence[Drive]) -> DrawnWorld:
        """Returns the world of some content; another one that is stored under its name is never drawn for it."""
        if content not in self.worlds:
            path = next((each.world_json for each in drives if each.world_json and each.world_content == content), None)
            world, note = read_world(path) if path else (None, _why_no_world(drives))
            fixtures = f"beside-{len(self.worlds) + 1}-fixtures"
            drawing = plan.draw_fixtures(world, Frame.of_world(world), fixtures) if world else None
            self.worlds[content] = DrawnWorld(world, note, fixtures, drawing)
        return self.worlds[content]


def same_world(before: JobRecord, after: JobRecord) -> tuple[str | None, str]:
    """Returns the content of the world that both jobs drove in, or why they have no plan in common.

    Returns:
        Digest of the content, `None` where neither drove in a generated world; and the reason why no plan is common to
        both, as a sentence, which is empty where one is.
    """
    if before.inputs is None or after.inputs is None:
        return None, "The world of one job is not known, so that there is no plan on which both paths belong."
    ours, theirs = before.inputs.world, after.inputs.world
    if ours != theirs:
        names = [job.world_title or "no generated world" for job in (before, after)]
        return None, (
            f"Not the same world: A drove in {names[0]}, B in {names[1]}. There is no plan on which both paths belong."
        )
    if ours is not None:
        return ours, ""
    used, robots = (
        [{each.digest for each in inputs.applications if each.role == role} for inputs in (before.inputs, after.inputs)]
        for role in ("simulation", "robot")
    )
    if all(used) and used[0] != used[1] and used == robots:
        return None, (
            "Robot and simulation are one package, which differs between A and B, and the jobs drove in no generated "
            "world: it is not known that the place is the same, so that the paths are not drawn on one plan."
        )
    if not used[0] or used[0] != used[1]:
        return None, (
            "The jobs drove in no generated world, and it is not known that their simulation applications are the "
            "same: their paths are not drawn on one plan."
        )
    return None, ""


def _missing_paths(jobs: Sequence[JobRecord], drives: Sequence[Drive]) -> str:
    """Returns which of the jobs have no path, as sentences; empty if both have one."""
    if all(map(_has_trials, jobs)) and not any(drive.trial_end for drive in drives):
        return "Both have trials; the page of a job shows the path of each that was recorded."
    told = []
    for letter, job, drive in zip("AB", jobs, drives, strict=True):
        if drive.result is not None and drive.result.path:
            continue
        if drive.trial_end in NOT_RUN:
            told.append(f"{letter} {drive.trial_end}: {drive.trial_title}.")
        elif drive.trial is not None and not drive.files:
            told.append(f"{letter} did not record {drive.trial_title}{_since_passed(drive)}: {_rerun(job, drive)}.")
        elif _has_trials(job) and drive.trial is None:
            told.append(f"{letter} has trials, and recorded none of them.")
        else:
            told.append(drive.trouble or f"{letter} left no path.")
    return " ".join(dict.fromkeys(told))


def _has_trials(job: JobRecord) -> bool:
    return any(item.name == OF_ALL_TRIALS for item in job.requirements)


def _why_no_world(drives: Sequence[Drive]) -> str:
    if any(drive.world_json for drive in drives):
        return "The world that is stored is not the one that both jobs drove in, so that no plan is drawn."
    return next((drive.trouble for drive in drives if drive.trouble), "The world is deleted, so that no plan is drawn.")


def _since_passed(drive: Drive) -> str:
    return ", as it passed" if drive.trial_end == "passed" else ""


def _rerun(job: JobRecord, drive: Drive) -> str:
    return f"`{repro_command(job.label, drive.trial)}` runs it again with a recording and a video"


def _why_no_video(drive: Drive, outcome: Outcome) -> str:
    if drive.trial_end in NOT_RUN:
        return f"No video: the job {drive.trial_end}."
    if drive.trial is not None and not drive.files:
        return f"No video: the trial was not recorded{_since_passed(drive)}."  # the plan's note has the command
    if drive.result is not None and (problem := drive.result.extra.get("video_error")):
        return f"No video: {outcomes.plain(str(problem))}."
    if drive.trial is not None:
        verdict = drive.result.verdict if drive.result is not None else ""
        return f"No video: {why_no_video_of_trial(drive.video_policy, verdict)}."
    if drive.video_policy == "on-failure" and not outcome.is_failure:
        return "No video: it was asked for failures only (on-failure)."
    if drive.video_policy == "none":
        return "No video: none was asked for."
    if any(file.name.startswith(f"{TRIALS_FOLDER}/") and file.name.endswith(f"/{_WHOLE}") for file in drive.files):
        return "No video of the job: its trials have their own."
    return "No video is stored."


def _end_of(result: RunResult | None) -> float:
    if result is None:
        return 0.0
    return max(result.sim_time_s, result.path[-1][0] if result.path else 0.0)


def _missed_first(requirements: Sequence[Requirement]) -> tuple[float, Requirement] | None:
    """Returns the simulated time (s) at which one of some requirements was missed first, and that one; else `None`."""
    times = [
        (item.first_violation_s, item)
        for item in requirements
        if item.counts and not item.satisfied and item.error is None and item.first_violation_s is not None
    ]
    return min(times, key=lambda each: (each[0], each[1].name), default=None)


def _first_miss(requirements: Sequence[Requirement]) -> Miss | None:
    found = _missed_first(requirements)
    return Miss(found[1].name.replace("_", " "), found[0]) if found else None


def _first_miss_in_words(job: JobRecord, outcome: Outcome) -> str:
    if own := next((item for item in job.requirements if item.name == OF_ALL_TRIALS), None):
        return own.detail
    missed = [item for item in job.requirements if item.counts and not item.satisfied and item.error is None]
    if not missed:
        judged = outcome in (Outcome.PASSED, Outcome.FAILED)
        return "missed none of its requirements" if judged and job.requirements else "was not judged"
    first = _missed_first(job.requirements)
    if first is None:
        names = ", ".join(item.name.replace("_", " ") for item in missed)
        return f"missed {names}"
    time_s, item = first
    place = "".join([f", in {item.room}" if item.room else "", f", {item.other}" if item.other else ""])
    return f"first missed {item.name.replace('_', ' ')} at {time_s:.1f} s{place}"


def _outcome_of(item: Requirement | None, of_trials: bool) -> tuple[str, str]:
    if item is None:
        return "unjudged", "not in its result"
    if item.error is not None:
        return "broken", "broke"
    if item.is_aside(of_trials=of_trials):
        return "unjudged", "does not count"
    return ("passed", "met") if item.satisfied else ("failed", "missed")


def _goals(drives: Sequence[Drive]) -> list[Goal]:
    """Returns the goals of both jobs' requests, in metres, each once; goals without a place are left out."""
    found: dict[Goal, None] = {}
    for drive in drives:
        for name, asked in drive.asked.items():
            if asked.get("kind") != "goal":
                continue
            x, y = asked.get("x"), asked.get("y")
            if isinstance(x, int | float) and isinstance(y, int | float):
                within_m = asked.get("within_m", 0.5)  # as the kind says where the request does not
                found[Goal(name, (float(x), float(y)), float(within_m))] = None
            elif isinstance(asked.get("room"), str):
                found[Goal(name, room=str(asked["room"]))] = None
    return list(found)
