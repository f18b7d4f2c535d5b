"""View model of the report page, computed from the report; the template only places its values."""

import re
import shlex
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from markupsafe import Markup

from ...schemas.reports.report import AxisResult, Report, ReportedFile, ReportedJob, ReportedStep, ReportSummary, Share
from ...schemas.reports.run_record import BEFORE_STEPS, CUT_SHORT
from ...schemas.reports.run_states import state_in_words
from ...schemas.runs.plan import Requirement, RunResult
from ...schemas.runs.programs import WAITS_FOR
from ...schemas.runs.trial_rows import TRIALS_FOLDER, TrialsSummary
from ...schemas.wire.common import counted
from ..results.table import ResultTable
from . import outcomes
from .answer import answer_of
from .causes import WhyView, view_why
from .drawings import plan
from .outcomes import Outcome, headline, outcome_of
from .pictures import Picture, PictureError, budget_for_each, embed_picture
from .summaries import folder_of, summarize, why_broken
from .worlds import TrialsView, WorldView, view_trials, view_worlds

_COLUMNS = (
    ("distance_m", "Distance", 1, "m"),
    ("sim_time_s", "Simulated time", 1, "s"),
    ("real_time_factor", "Real-time factor", 1, "×"),
    ("collisions", "Collisions", 0, ""),
    ("max_force_N", "Largest force", 0, "N"),
    ("wall_time_s", "Wall time", 1, "s"),
)
"""Columns of the table of jobs: member of `Numbers`, title, digits and unit."""
_OF_TRIAL = re.compile(rf"{TRIALS_FOLDER}/(\d+)/")
_RECORDING = "recording.mcap"
_KNOWN_METRICS = frozenset({"distance_m", "collisions", "max_force_N", "sim_time_s", "wall_time_s", "real_time_factor"})
_SHOWN_AFTER_S = 1.0
"""Shortest time after a job's run that its card shows, in seconds."""


@dataclass(frozen=True)
class Measure:
    """One number of a job in the report, with its name and unit."""

    name: str
    value: str
    unit: str = ""


@dataclass(frozen=True)
class Numbers:
    """Numbers of a job for the report's comparison table; `None` where unknown."""

    rooms_visited: int | None = None
    rooms: int | None = None
    distance_m: float | None = None
    sim_time_s: float | None = None
    real_time_factor: float | None = None
    collisions: float | None = None
    max_force_N: float | None = None  # noqa: N815 - the unit is part of the name
    wall_time_s: float | None = None

    @property
    def rooms_text(self) -> str:
        """Number of visited rooms and of all rooms as text: `5/6`."""
        return "–" if not self.rooms else f"{self.rooms_visited}/{self.rooms}"


@dataclass(frozen=True)
class FileView:
    """An output file in a report; `link` is empty if browsers cannot open its address."""

    name: str
    uri: str
    link: str
    size: str
    hint: str
    of_trial: int | None = None
    """Number of the recorded trial that the file belongs to; `None`: to the job."""

    @property
    def short(self) -> str:
        """Name of the file within its trial's folder."""
        return self.name if self.of_trial is None else self.name.split("/", 2)[-1]


@dataclass(frozen=True)
class JobView:
    """A job's card and table row in a report."""

    anchor: str
    job: ReportedJob
    outcome: Outcome
    number: int
    title: str
    missed: list[str]
    reason: str
    log: str
    world: WorldView | None
    numbers: Numbers
    measures: list[Measure]
    more: list[Measure]
    plan: Markup | None
    plan_note: str
    poster: Picture | None
    poster_note: str
    files: list[FileView]
    folder: str
    seconds: tuple[str, str] | None
    """Formatted simulated time at the path's start and end."""
    trials: TrialsView | None = None
    """Trials of the job, if it has any."""

    @property
    def key(self) -> str:
        """CSS class and icon of the job's state: a known failure has the colour of what is not judged."""
        return Outcome.UNJUDGED.key if self.job.known else self.outcome.key

    @property
    def state(self) -> str:
        """The job's state in a word or two: `passed`, `known failure`."""
        return "known failure" if self.job.known else self.outcome.value

    @property
    def result(self) -> RunResult | None:
        """The job's result, if it has one."""
        return self.job.result

    @property
    def end(self) -> str:
        """End of the job in words: `ended by agent`; its status where it has no result.

        Trials end each by its own cause, so a job that ran all of them says their number: `ran 8 trials`.
        """
        if self.job.result is None:
            return self.job.status
        if self.trials is not None and self.trials.stopped_in is None:
            return f"ran {counted(self.trials.counts.total, 'trial')}"
        return f"ended by {self.job.result.ended_by}"

    @property
    def drawn(self) -> RunResult | None:
        """The result whose path is on the job's plan."""
        return _drawn(self.job)

    @property
    def requirements(self) -> list[tuple[Requirement, bool]]:
        """The job's requirements, and whether each counts for nothing: those that are not met first, such ones last."""
        found = self.job.result.requirements if self.job.result is not None else []
        marked = [(item, item.is_aside(of_trials=self.trials is not None)) for item in found]
        return sorted(marked, key=lambda each: (each[1], each[0].satisfied))


@dataclass(frozen=True)
class Page:
    """All values that the HTML template of a run's report needs."""

    report: Report
    headline: str
    answer: str
    """Result of the run in one sentence without full stop: how many passed, and what is new since the last run."""
    numbers: ReportSummary
    duration: str
    longest_step_s: float
    jobs: list[JobView]
    worlds: list[WorldView]
    why: WhyView | None

    @property
    def steps(self) -> list[ReportedStep]:
        """Steps of the specification; the record of a refused run has one more, with the reason."""
        return [step for step in self.report.steps if step.name != BEFORE_STEPS]

    @property
    def columns(self) -> list[tuple[str, str, int, str]]:
        """Columns of numbers of the table of jobs, without those that no job has a number in."""
        return [each for each in _COLUMNS if any(getattr(job.numbers, each[0]) is not None for job in self.jobs)]

    @property
    def anchors(self) -> dict[str, str]:
        """HTML anchors of the jobs' cards, by id of the job."""
        return {job.job.label: job.anchor for job in self.jobs}

    @property
    def anchor_links(self) -> dict[str, str]:
        """Links to the jobs' cards, by job label."""
        return {title: f"#{anchor}" for title, anchor in self.anchors.items()}

    @property
    def beside_last(self) -> str:
        """Command that shows the run and the one before side by side; empty: there is none before."""
        since = self.report.since_last
        if since is None or since.previous_run_id is None or not since.paired:
            return ""
        return f"robomaker compare {since.previous_run_id} {self.report.run_id} --report compared.html"

    def beside_first(self, axis: AxisResult) -> str:
        """Returns the command that shows two values of an axis side by side."""
        cell = f"{axis.step}.{axis.axis}={axis.comparisons[0].value}"
        return shlex.join(["robomaker", "compare", self.report.run_id, "--axis", cell, "--report", "compared.html"])

    @property
    def is_compared(self) -> bool:
        """Whether the page has a section on what changed: there is an earlier run, of which the answer says the sum."""
        return self.report.since_last is not None and self.report.since_last.previous_run_id is not None

    @property
    def sections(self) -> list[tuple[str, str]]:
        """Anchors and titles of the sections that the page has, in the order of the page."""
        found: list[tuple[str, str, object]] = [
            ("challenge", "Sabotages", self.report.challenge),
            ("since", "What changed", self.is_compared),
            ("failures", "What failed", self.failures),
            ("errors", "What broke", self.errors),
            ("known", "Known failures", self.known),
            ("table", "All jobs", self.jobs),
            ("breakdown", "Where", self.has_breakdown),
            ("why", "Why", self.why),
            ("axes", "Axes", self.report.axes),
            ("effects", "What depends on which axis", self.report.effects),
            ("time", "Time", True),
            ("jobs", self.title_of_others, self.others),
            ("worlds", "Worlds", self.worlds),
            ("environment", "Versions", self.report.versions),
        ]
        return [(anchor, title) for anchor, title, is_there in found if is_there]

    @property
    def title_of_others(self) -> str:
        """Title of the section of jobs that are in no section of failures."""
        return "Other jobs" if self.failures or self.errors or self.known else "Jobs"

    @property
    def shown_state(self) -> str:
        """State of the run in the word for its jobs: `passed` if it succeeded and each of them passed."""
        return state_in_words(self.report.state, self.numbers.counts)

    @property
    def judged_of_all(self) -> str:
        """Share of judged jobs of a run that did not end by itself: `9 of 60 jobs judged`; else empty."""
        if self.report.state not in CUT_SHORT:
            return ""
        judged = sum(job.outcome in (Outcome.PASSED, Outcome.FAILED) for job in self.jobs)
        return f"{judged} of {counted(len(self.jobs), 'job')} judged"

    @property
    def counting(self) -> str:
        """Explains which trials the page counts as judged; empty if each job is one trial."""
        if self.numbers.trials == len(self.jobs):
            return ""
        return "Judged are the trials that passed or failed."

    @property
    def counts(self) -> dict[tuple[str, str], int]:
        """Numbers of jobs by state, with its CSS class, the worst first."""
        counts = Counter((job.key, job.state) for job in sorted(self.jobs, key=lambda job: job.outcome.rank))
        return dict(counts)

    @property
    def failures(self) -> list[JobView]:
        """Jobs that missed requirements and are not on the specification's list of known failures, in request order."""
        return [job for job in self.jobs if job.outcome is Outcome.FAILED and not job.job.known]

    @property
    def known(self) -> list[JobView]:
        """Jobs that missed requirements as the specification's list of known failures says, in request order."""
        return [job for job in self.jobs if job.job.known]

    @property
    def errors(self) -> list[JobView]:
        """Jobs that ended with an error (crashed, were not started, ...), in request order."""
        return [job for job in self.jobs if job.outcome is Outcome.BROKEN]

    @property
    def reused(self) -> int:
        """Number of jobs that reused results of earlier jobs."""
        return sum(job.job.reused_from is not None for job in self.jobs)

    @property
    def waits(self) -> str:
        """Summary of how long jobs waited for their machines: `12 of 40 jobs: 3 min 5 s for memory in all`."""
        waited = [job.job.waited_s for job in self.jobs if job.job.waited_s]
        if not waited:
            return ""
        totals = [(words, sum(each.get(scarce, 0.0) for each in waited)) for scarce, words in WAITS_FOR.items()]
        told = [f"{outcomes.duration(total_s)} for {words}" for words, total_s in totals if total_s]
        jobs = f"{len(self.jobs)} {'job' if len(self.jobs) == 1 else 'jobs'}"
        return f"{len(waited)} of {jobs}: {', '.join(told)} in all"

    @property
    def owners(self) -> str:
        """Programs that ran the jobs, by machine: `robomaker run on ada: 12 jobs`."""
        found = (job.job.carried_out_by for job in self.jobs if job.job.reused_from is None)
        counts = Counter(f"{owner.program} on {owner.machine}" for owner in found if owner is not None)
        return ", ".join(f"{name}: {count} {'job' if count == 1 else 'jobs'}" for name, count in counts.most_common())

    @property
    def times(self) -> str:
        """Wall time of the run by activity: `worlds 12 s, simulation 80 s, videos of failures 40 s, uploads 5 s`.

        Jobs whose results were taken over from earlier runs do not count; empty if there are no others.
        """
        jobs = [job.job for job in self.jobs if job.job.reused_from is None]
        if not jobs:
            return ""
        worlds = (step.duration_s for step in self.report.steps if step.operation == "CreateWorldGenerationJob")
        simulation, videos = outcomes.times_with_videos(job.request for job in jobs)
        parts = {
            "worlds": sum(worlds),
            "waiting": sum(sum(job.waited_s.values()) for job in jobs),
            simulation: sum(job.duration_s or 0.0 for job in jobs),
            videos: sum(job.video_s or 0.0 for job in jobs),
            "uploads": sum(job.upload_s or 0.0 for job in jobs),
        }
        return outcomes.times_by_part(parts)

    @property
    def origins(self) -> list[str]:
        """Ids of the runs or jobs whose results were reused."""
        return sorted({job.job.reused_from for job in self.jobs if job.job.reused_from})

    @property
    def shared_worlds(self) -> list[Share]:
        """Pass rates by world, if any world had more than one job."""
        shares = self.numbers.worlds
        return shares if any(share.passed + share.failed + share.errors > 1 for share in shares) else []

    @property
    def has_breakdown(self) -> bool:
        """Whether tables by requirement, world or room add information to the jobs' cards."""
        return len(self.jobs) > 1 and any((self.numbers.requirements, self.shared_worlds, self.numbers.rooms))

    @property
    def begun(self) -> list[JobView]:
        """Jobs, and requests of which no job came, without those whose batch ended before: these are one sentence."""
        return [job for job in self.jobs if not outcomes.never_began(job.job)]

    @property
    def never_began(self) -> str:
        """Sentence without full stop on the requests whose batch ended before; empty: there are none."""
        left = len(self.jobs) - len(self.begun)
        return outcomes.never_began_in_words(left, is_decided=self.report.stopped_early)

    @property
    def others(self) -> list[JobView]:
        """Jobs that neither failed nor had an error; those that need attention come first."""
        return sorted((job for job in self.begun if not job.outcome.is_failure), key=lambda job: job.outcome.rank)


def view_report(report: Report, results: ResultTable | None = None) -> Page:
    """Computes the values for the HTML page of a run's report.

    Args:
        report: Report to show.
        results: Table of results of the report's trials; None: each job is one trial.
    """
    pictures = sum(bool(world.preview_png) for world in report.worlds) + sum(
        bool(job.poster_png) for job in report.jobs
    )
    budget = budget_for_each(pictures)
    worlds = view_worlds(report, budget)
    by_arn = {view.world.arn: view for view in worlds}
    numbers = summarize(report, results)
    return Page(
        report=report,
        headline=headline(report),
        answer=answer_of(report, numbers),
        numbers=numbers,
        duration=outcomes.duration((report.ended_at - report.started_at).total_seconds()),
        longest_step_s=max((step.duration_s for step in report.steps), default=0.0),
        jobs=[_view_job(job, index, by_arn, budget) for index, job in enumerate(report.jobs, start=1)],
        worlds=worlds,
        why=view_why(report.why),
    )


def _view_job(job: ReportedJob, index: int, worlds: Mapping[str, WorldView], budget_bytes: int) -> JobView:
    world = worlds.get(job.world_arn) if job.world_arn else None
    drawing, note = _job_plan(job, world)
    poster, poster_note = _poster(job, budget_bytes)
    numbers = _numbers(job)
    is_judged = job.result is not None and job.result.verdict != "ERROR"
    reason = outcomes.plain(job.failure_reason or "") if is_judged else why_broken(job)
    return JobView(
        anchor=f"job-{index}",
        job=job,
        outcome=outcome_of(job),
        number=index,
        title=job.title,
        missed=_missed(job),
        reason=reason,
        log="" if job.log_tail.strip() in reason else outcomes.plain(job.log_tail),
        world=world,
        numbers=numbers,
        measures=[*_measures(numbers), *_besides(job)],
        more=_other_metrics(job.result),
        plan=drawing,
        plan_note=note,
        poster=poster,
        poster_note=poster_note,
        files=[_view_file(file) for file in job.files],
        folder=folder_of(job),
        seconds=_path_seconds(_drawn(job)),
        trials=view_trials(job),
    )


def _missed(job: ReportedJob) -> list[str]:
    """Returns the names of the requirements that determined a job's verdict; empty if it passed or has no result."""
    if job.result is None or job.result.verdict not in ("FAIL", "ERROR"):
        return []
    return [item.name.replace("_", " ") for item in job.result.requirements if item.counts and not item.satisfied]


def _job_plan(job: ReportedJob, world: WorldView | None) -> tuple[Markup | None, str]:
    """Returns the floor plan of a job with its path, or `None`, and the text to show where there is no plan.

    A job without a generated world has only its path, with that text.
    """
    drawn, name = _drawn(job), job.title if job.drawn_trial is None else f"trial {job.drawn_trial} of {job.title}"
    if drawn is None:
        return None, _why_no_path(job)
    if not drawn.path and TrialsSummary.of(drawn) is not None:
        return None, ""  # no trial was recorded, and the world's card has the plan without a path
    if world is not None and world.content is not None and world.frame is not None:
        title = f"Plan of {world.world.title} with the path of {name}"
        return plan.draw_job_plan(world.content, world.frame, world.fixtures, drawn, title), ""
    if world is not None:
        missing = f"No plan of {world.world.title}: {world.note}"
    elif job.world_arn:
        missing = f"The world {job.world_arn} is not part of this report."
    else:
        missing = "This job drove in no generated world."
    return plan.draw_bare_path(drawn, f"Path of {name}"), missing


def _why_no_path(job: ReportedJob) -> str:
    """Says why there is no path of a job without a result, and which file has what it drove."""
    if not any(file.name == _RECORDING for file in job.files):
        return "The job left no result.json, so there is nothing to draw."
    is_broken = outcome_of(job) is Outcome.BROKEN
    why = "The job broke before it wrote" if is_broken else "The job ended before it wrote"
    return f"{why} result.json, so no path is drawn; {_RECORDING} has what it drove."


def _drawn(job: ReportedJob) -> RunResult | None:
    """Returns the result whose path is drawn: of a job with trials that of a recorded trial."""
    return job.result if job.drawn_result is None else job.drawn_result


def _poster(job: ReportedJob, budget_bytes: int) -> tuple[Picture | None, str]:
    if not job.poster_png:
        return None, ""
    try:
        return embed_picture(job.poster_png, budget_bytes), ""
    except PictureError as error:
        return None, f"Frame of the video: {error}."


def _numbers(job: ReportedJob) -> Numbers:
    result = job.result
    if result is None:
        return Numbers(wall_time_s=job.duration_s)
    is_simulated = result.sim_time_s > 0  # programs on their own have no simulation of ours: its noughts mean nothing
    strongest = max((collision.max_force_N for collision in result.collisions), default=None)
    # An environment that neither lists nor counts them has not looked.
    listed = float(len(result.collisions)) or None
    return Numbers(
        rooms_visited=sum(room.visited for room in result.rooms),
        rooms=len(result.rooms),
        distance_m=result.metrics.get("distance_m"),
        sim_time_s=result.sim_time_s if is_simulated else None,
        real_time_factor=result.real_time_factor if is_simulated else None,
        # The list of collisions is cut at 200; the metric counts all.
        collisions=result.metrics.get("collisions", listed),
        max_force_N=result.metrics.get("max_force_N", result.metrics.get("max_contact_force_N", strongest)),
        wall_time_s=result.wall_time_s if job.duration_s is None else job.duration_s,
    )


def _measures(numbers: Numbers) -> list[Measure]:
    if not numbers.sim_time_s:  # programs on their own, without a simulation of ours: all else is nought
        return [Measure("wall time", outcomes.number(numbers.wall_time_s, 1), "s")] if numbers.wall_time_s else []
    measures = [
        Measure("rooms visited", numbers.rooms_text if numbers.rooms else "–"),
        Measure("distance", outcomes.number(numbers.distance_m, 1), "m"),
        Measure("collisions", outcomes.number(numbers.collisions, 0)),
        Measure("largest force", outcomes.number(numbers.max_force_N, 0), "N"),
        Measure("simulated time", outcomes.number(numbers.sim_time_s, 1), "s"),
        Measure("wall time", outcomes.number(numbers.wall_time_s, 1), "s"),
        Measure("real-time factor", outcomes.number(numbers.real_time_factor, 1), "×"),
    ]
    return [measure for measure in measures if measure.value != "–"]


def _besides(job: ReportedJob) -> list[Measure]:
    """Returns the job's times that its wall time does not include: waiting before it ran, videos and uploads after."""
    waits = {f"waited for {WAITS_FOR[scarce]}": time_s for scarce, time_s in job.waited_s.items()}
    after = {"videos after the run": job.video_s or 0.0, "upload": job.upload_s or 0.0}
    shown = {name: time_s for name, time_s in after.items() if time_s >= _SHOWN_AFTER_S}
    return [Measure(name, outcomes.number(time_s, 1), "s") for name, time_s in (waits | shown).items()]


def _other_metrics(result: RunResult | None) -> list[Measure]:
    if result is None:
        return []
    measures = []
    for metric, value in sorted(result.metrics.items()):
        if metric not in _KNOWN_METRICS:
            name, unit = outcomes.name_and_unit(metric)
            measures.append(Measure(name, outcomes.compact(value), unit))
    return measures


def _view_file(file: ReportedFile) -> FileView:
    # Anything else, `javascript:` above all, stays text.
    link = file.uri if file.uri.startswith(("file:///", "http://", "https://")) else ""
    hint = "open in Foxglove" if file.name.endswith(".mcap") else ""
    in_trial = _OF_TRIAL.match(file.name)
    of_trial = int(in_trial[1]) if in_trial else None
    return FileView(file.name, file.uri, link, outcomes.size(file.size_bytes), hint, of_trial)


def _path_seconds(result: RunResult | None) -> tuple[str, str] | None:
    if result is None or len(result.path) < 2:
        return None
    return f"{result.path[0][0]:.0f} s", f"{result.path[-1][0]:.0f} s"
