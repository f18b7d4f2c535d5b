"""Histories: since when jobs fail, what changed then, which are unsteady, and what changed since the last run."""

from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import digest, make_job, make_night, make_trials_night
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.deployments.cli.output.comparison import history_lines, newest_lines
from prefect_robomaker.schemas.reports.changes import ChangedInput
from prefect_robomaker.schemas.reports.history import History
from prefect_robomaker.schemas.reports.run_record import BEFORE_STEPS, JobRecord, StepRecord
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.history import history_of, since_last_run
from prefect_robomaker.tasks.notifications.notification_texts import message_of
from prefect_robomaker.tasks.reporting import render_history
from prefect_robomaker.tasks.reporting.nights.changes import shared_since, since_in_words
from prefect_robomaker.tasks.results.rates import wilson_interval


def runs(*nights: Any, **members: Any) -> list[NightRun]:
    return [NightRun.of(make_night(each, index, **members)) for index, each in enumerate(nights)]


def history(*nights: Any, **members: Any) -> History:
    return history_of("nightly", runs(*nights, **members))


def test_a_first_run_has_nothing_to_be_compared_with() -> None:
    since = since_last_run(runs("PF"))
    assert (since.previous_run_id, since.paired, since.unpaired) == (None, 0, 2)
    assert (since.newly_failing, since.newly_passing, since.still_failing) == ([], [], [])
    assert [each.cell.test for each in since.first_failing] == ["world-2 scout"]


def test_what_changed_since_the_last_run() -> None:
    since = since_last_run(runs("PPFFP", "PFPFE"))
    assert since.previous_run_id == "nightly-20260301T020000000"
    assert [each.cell.test for each in since.newly_failing] == ["world-2 scout", "world-5 scout"]
    assert [each.outcome for each in since.newly_failing] == ["failed", "broken"]
    assert [each.cell.test for each in since.newly_passing] == ["world-3 scout"]
    assert [each.cell.test for each in since.still_failing] == ["world-4 scout"]
    assert since.newly_failing[0].job == "sim-1-1"
    assert since.newly_failing[0].reason == "gentle: 9 N, at most 5 N asked"
    assert (since.paired, since.unpaired, since.first_failing) == (5, 0, [])


def test_a_canceled_night_of_trials_counts_jobs(tmp_path: Path) -> None:
    """A job that was canceled has one row for all the trials that it never ran: trials would say too much."""
    night = make_trials_night(["PPP", "PFP"], runs=tmp_path)
    jobs = [*night.jobs, make_job(2, "C"), make_job(3, "C")]
    told = history_of("nightly", [NightRun.of(night.model_copy(update={"state": "canceled", "jobs": jobs}))])
    assert told.nights[0].cut_short == "canceled, 2 of 4 jobs judged"


def test_a_failure_began_with_the_first_run_after_the_last_pass() -> None:
    nights = [make_night("P", 0), make_night("F", 1, commit="b", robot="robot 2"), make_night("C", 2, commit="b")]
    nights += [make_night("F", 3, commit="c", robot="robot 2"), make_night("E", 4, commit="c", robot="robot 2")]
    (failing,) = since_last_run([NightRun.of(each) for each in nights]).still_failing
    assert failing.since is not None
    assert (failing.since.run_id, failing.since.nights) == ("nightly-20260302T020000000", 3)
    assert failing.since.last_passed_run_id == "nightly-20260301T020000000"
    assert failing.since.changed == [
        ChangedInput(what="commit", before=digest("a")[:40], after=digest("b")[:40]),
        ChangedInput(what="application", name="scout", before=digest("robot 1"), after=digest("robot 2")),
    ]


def test_a_failure_may_have_begun_with_another_request_or_version_or_with_nothing() -> None:
    first = NightRun.of(make_night("P"))
    later = make_night([make_job(0, "F", night=1, request="other")], 1)
    later = NightRun.of(later.model_copy(update={"versions": {"prefect-robomaker": "0.2.0"}}))
    (failing,) = since_last_run([first, later]).newly_failing
    assert failing.since is not None
    assert failing.since.changed == [
        ChangedInput(what="version", name="prefect-robomaker", before="0.1.0", after="0.2.0"),
        ChangedInput(what="request"),
    ]
    (same,) = since_last_run(runs("P", "F")).newly_failing
    assert same.since is not None
    assert same.since.changed == []
    (never,) = since_last_run(runs("F", "F")).still_failing
    assert never.since is not None
    assert (never.since.nights, never.since.last_passed_run_id) == (2, None)


@pytest.mark.parametrize(
    ("nights", "said"),
    [
        ("FF", "fails since 2026-03-01 02:00:00 UTC, 2 runs; "),
        ("EE", "breaks since 2026-03-01 02:00:00 UTC, 2 runs; "),
        ("EFF", "fails or breaks since 2026-03-01 02:00:00 UTC, 3 runs: failed in 2, broke in 1; "),
    ],
)
def test_a_job_that_broke_is_not_told_as_failed(nights: str, said: str) -> None:
    (still,) = since_last_run(runs(*nights)).still_failing
    assert still.since is not None
    assert since_in_words(still.since).startswith(said)
    both = since_last_run(runs(*(2 * night for night in nights))).still_failing
    together = said.replace("fails", "All fail", 1).replace("breaks", "break" if "fails" in said else "All break", 1)
    assert shared_since(both).startswith(together)
    assert shared_since([still]) == ""


def test_a_job_is_compared_with_its_own_last_result() -> None:
    """A run between that only had some of the jobs, or was canceled, takes nothing away."""
    some = [make_job(1, "P", night=1)]
    since = since_last_run(runs("PFP", some, "CCC", "FPP"))
    assert since.previous_run_id == "nightly-20260302T020000000"
    assert [each.cell.test for each in since.newly_failing] == ["world-1 scout"]
    assert since.newly_passing == [], "it passed in the run between already"
    assert (since.paired, since.unpaired) == (3, 0)


def test_worlds_that_are_others_every_night_cannot_be_compared() -> None:
    nights = [[make_job(0, "F", night=night, world=f"night {night}")] for night in range(3)]
    found = history(*nights)
    assert (found.since_last.paired, found.since_last.unpaired) == (0, 1)
    assert (len(found.cells), found.cells_left_out) == (1, 2)


def test_jobs_that_change_their_result_with_the_same_inputs_are_unsteady() -> None:
    found = history("PPP", "FPP", "PPP")
    assert [(cell.unsteady, cell.same_inputs, cell.changes) for cell in found.cells] == [
        (True, True, 2), (False, False, 0), (False, False, 0)
    ]  # fmt: skip


@pytest.mark.parametrize(
    "trials", [pytest.param(("a", "b"), id="trials are known"), pytest.param((None, None), id="an early release")]
)
def test_jobs_with_other_values_of_axes_have_other_inputs(trials: tuple[str | None, str | None]) -> None:
    """Records of early releases do not know their trials; those of two runs are the same at most as parameters are."""
    plain, delayed = (
        NightRun.of(make_night(letter, night, trials=value).model_copy(update={"parameters": {"delay": 0.6 * night}}))
        for night, (letter, value) in enumerate(zip("PF", trials, strict=True))
    )
    again = NightRun.of(make_night("F", 2, trials=trials[0]).model_copy(update={"parameters": {"delay": 0.0}}))
    other, same = (history_of("nightly", nights).cells[0] for nights in ([plain, delayed], [plain, again]))
    assert (other.same_inputs, other.unsteady) == (False, False)
    assert (same.same_inputs, same.unsteady) == (True, True)
    assert other.since is not None
    assert [each.what for each in other.since.changed] == ["parameter", *(["request"] if trials[0] else [])]


def test_jobs_that_change_with_their_inputs_are_unsteady_from_three_changes_on() -> None:
    def nights(letters: str) -> History:
        made = [make_night(letter, night, robot=f"robot {night}") for night, letter in enumerate(letters)]
        return history_of("nightly", [NightRun.of(each) for each in made])

    (twice,), (thrice,) = nights("PFP").cells, nights("PFPF").cells
    assert (twice.unsteady, thrice.unsteady, thrice.same_inputs) == (False, True, False)


def test_a_crash_is_no_sign_of_unsteadiness_by_itself() -> None:
    (cell,) = history("P", "E", "E").cells
    assert (cell.same_inputs, cell.unsteady) == (False, False)


def test_nights_cells_worlds_and_requirements_have_rates() -> None:
    found = history("PPF", "PFE", "CCC")
    assert [(n.success.passed, n.success.failed, n.success.errors) for n in found.nights] == [
        (2, 1, 0), (1, 1, 1), (0, 0, 0)
    ]  # fmt: skip
    assert found.nights[0].success.rate == 2 / 3
    assert found.nights[0].success.low is not None
    assert found.nights[2].success.rate is None
    # Those that fail stand first, of them those that are unsteady.
    assert [cell.cell.test for cell in found.cells] == ["world-2 scout", "world-3 scout", "world-1 scout"]
    assert found.cells[1].outcomes == ["failed", "broken", "canceled"]
    assert [(each.total.name[:7], each.total.passed, each.total.failed) for each in found.worlds] == [
        ("world-3", 0, 1), ("world-2", 1, 1), ("world-1", 2, 0)
    ]  # fmt: skip
    (gentle,) = found.requirements
    assert (gentle.total.name, gentle.total.passed, gentle.total.failed) == ("gentle", 3, 2)
    assert gentle.nights[2] is None


def test_nights_say_what_changed_from_one_to_the_next() -> None:
    made = [make_night("P", 0), make_night("P", 1), make_night("P", 2, commit="b", robot="robot 2")]
    nights = history_of("nightly", [NightRun.of(each) for each in made]).nights
    assert [[change.what for change in night.changed] for night in nights] == [[], [], ["commit", "application"]]


def test_other_requirements_are_told_wherever_results_are() -> None:
    """A night that is green since less is asked for is not taken for a better robot."""
    strict = make_night("FF", 0)
    loose = make_night([make_job(0, "P", night=1, limit=100_000.0), make_job(1, "F", night=1)], 1)
    told = history_of("nightly", [NightRun.of(strict), NightRun.of(loose)])
    assert [[change.what for change in night.changed] for night in told.nights] == [[], ["requirements"]]
    assert len(told.since_last.newly_passing) == told.since_last.other_requirements == 1
    assert "1 job was judged by other requirements than before" in "\n".join(history_lines(told, Path("page")))
    assert "1 job was judged by other requirements than before" in message_of(loose, strict, told.since_last).body
    same = since_last_run([NightRun.of(strict), NightRun.of(make_night("FF", 1))])
    assert "other requirements" not in message_of(strict, strict, same).body


def test_early_records_have_a_rate_and_no_cells() -> None:
    early = [make_job(0, "P").model_copy(update={"inputs": None})]
    found = history(early, "P")
    assert found.nights[0].success.passed == 1
    assert [cell.outcomes for cell in found.cells] == [[None, "passed"]]


@given(st.lists(st.text("PFECN", min_size=3, max_size=3), min_size=1, max_size=12))
def test_every_failing_job_says_since_when(letters: list[str]) -> None:
    found = history(*letters)
    told = {"P": True, "F": False, "E": False}
    for index in range(3):
        results = [told[night[index]] for night in letters if night[index] in told]
        (cell,) = [each for each in found.cells if each.cell.test == f"world-{index + 1} scout"]
        assert (cell.since is not None) == (bool(results) and not results[-1])
        if cell.since:
            assert results[-cell.since.nights :] == [False] * cell.since.nights
            assert (cell.since.last_passed_run_id is not None) == any(results)


def test_a_known_failure_is_marked_in_what_changed_and_not_red() -> None:
    nights = [make_night([make_job(0, "F", night=night)], night) for night in (0, 1)]
    known = "anna until 2027-01-15: ticket 512"
    told = [job.model_copy(update={"known": known}) for job in nights[1].jobs]
    found = history_of(
        "nightly", [NightRun.of(each) for each in (nights[0], nights[1].model_copy(update={"jobs": told}))]
    )
    assert [each.known for each in found.since_last.still_failing] == [known]
    page = render_history(found, Path("runs"))
    assert f"Known: {known}" in page
    assert '<div class="change still">' in page
    assert '<div class="change failed' not in page
    assert any(
        line.endswith(f"(known, {known}): gentle: 9 N, at most 5 N asked") for line in history_lines(found, Path())
    )


def test_nights_that_repeat_to_the_bit_count_once_in_totals() -> None:
    """The same job with the same inputs goes the same way every night: thirty nights are one trial."""
    made = [
        make_night([make_job(0, "P", night=night).model_copy(update={"state_digest": "s" if night else None})], night)
        for night in range(5)
    ]
    found = history_of("nightly", [NightRun.of(each) for each in made])

    for share in (found.worlds[0].total, found.requirements[0].total, found.cells[0].success):
        assert (share.passed, share.failed, share.copies) == (5, 0, 3), share.name
        assert (share.low, share.high) == wilson_interval(2, 2)
    assert [each and each.copies for each in found.worlds[0].nights] == [0] * 5


def test_a_night_that_took_over_all_results_is_not_counted_again() -> None:
    first = make_night("PF", 0)
    jobs = [
        job.model_copy(update={"reused_from": first.run_id, "known": "anna until 2027-01-15" if index else ""})
        for index, job in enumerate(make_night("PF", 1).jobs)
    ]
    nights = [first, make_night(jobs, 1)]

    history = history_of("nightly", [NightRun.of(each) for each in nights])

    assert (history.nights[1].success.rate, history.nights[1].taken_over) == (None, 2)
    assert [cell.success.passed + cell.success.failed for cell in history.cells] == [1, 1]
    assert [each.total.passed + each.total.failed for each in history.requirements] == [2]
    lines = history_lines(history, Path("page"))
    assert any(line.endswith("0      0      0  taken over, 1 known") for line in lines), lines
    alone = history_of("nightly", [NightRun.of(nights[1])])
    assert alone.nights[0].success.passed == 1, "the run that they are of is not looked at"


def reused(origin: str, letters: str, night: int) -> list[JobRecord]:
    """Jobs of a night; those with a small letter took over results of a run."""
    jobs = [make_job(index, each.upper(), night=night) for index, each in enumerate(letters)]
    return [
        job.model_copy(update={"reused_from": origin if each.islower() else None})
        for job, each in zip(jobs, letters, strict=True)
    ]


def test_results_of_a_run_that_is_not_looked_at_count_once() -> None:
    nights = [make_night(reused("nightly-1", "ppf", night), night) for night in range(4)]

    found = history_of("nightly", [NightRun.of(each) for each in nights])

    assert [(night.taken_over, night.success.passed) for night in found.nights] == [(0, 2), (3, 0), (3, 0), (3, 0)]
    assert sorted((cell.success.passed, cell.success.failed) for cell in found.cells) == [(0, 1), (1, 0), (1, 0)]
    assert [each.total.passed + each.total.failed for each in found.worlds] == [1, 1, 1]
    assert [(each.total.passed, each.total.failed) for each in found.requirements] == [(2, 1)]


def test_results_that_some_jobs_took_over_count_for_no_world_and_requirement_again(tmp_path: Path) -> None:
    nights = [make_trials_night(["PPF", "PFF"], night, runs=tmp_path) for night in range(2)]
    taken = nights[1].jobs[0].model_copy(update={"reused_from": nights[0].run_id})
    nights[1] = nights[1].model_copy(update={"jobs": [taken, nights[1].jobs[1]]})

    found = history_of("nightly", [NightRun.of(each) for each in nights])

    assert found.nights[1].taken_over == 1
    counts = [(each.total.name[:7], each.total.passed, each.total.failed) for each in found.worlds]
    assert counts == [("world-2", 2, 4), ("world-1", 2, 1)]
    assert [(each.total.passed, each.total.failed) for each in found.requirements] == [(4, 5)]
    assert [each and each.passed for each in found.worlds[1].nights] == [2, None]


def margins_night(night: int, *margins: float) -> NightRun:
    jobs = [make_job(index, "P", night=night) for index in range(len(margins))]
    met = [job.requirements[0].model_copy(update={"margin": each}) for job, each in zip(jobs, margins, strict=True)]
    return NightRun.of(
        make_night(
            [job.model_copy(update={"requirements": [each]}) for job, each in zip(jobs, met, strict=True)], night
        )
    )


def test_margins_that_may_have_fallen_by_chance_are_no_news() -> None:
    by_chance = since_last_run([margins_night(0, 3.0, 4.0, 1.0), margins_night(1, 2.9, 1.0, 1.0)])
    untested = since_last_run([margins_night(0, 3.0), margins_night(1, 1.0)])
    sure = since_last_run([margins_night(0, 3.8, 4.0, 4.2), margins_night(1, 1.2, 1.3, 1.7)])

    assert (by_chance.margins, untested.margins) == ([], [])
    assert [each.name for each in sure.margins] == ["gentle"]


def test_a_night_whose_step_broke_before_its_jobs_says_why() -> None:
    error = "InvalidParameterException: the archive\ncannot be read"
    steps = [
        StepRecord(name="worlds", operation="CreateWorldGenerationJob", status="Completed"),
        StepRecord(name="robot", operation="CreateRobotApplication", status="Failed", error=error),
    ]
    night = make_night("", 1).model_copy(update={"state": "broken", "steps": steps})

    history = history_of("nightly", [NightRun.of(make_night("P", 0)), NightRun.of(night)])

    told = "step robot: InvalidParameterException: the archive cannot be read"
    printed = "\n".join(history_lines(history, Path("page")))
    assert f"  The last run made no jobs: {told}\n" in printed
    assert f"0  broken: {told}" in printed
    page = render_history(history, Path("page"))
    assert "2 runs; the last one made no jobs" in page
    assert told in page
    assert newest_lines({"nightly": history.nights[-1]})[0].endswith(f"broken, {told}")
    jobs = make_night("E", 1).model_copy(update={"state": "broken", "steps": steps})
    assert not jobs.step_error, "its job tells why"
    failed = make_night("F", 1).model_copy(update={"state": "broken", "steps": steps})
    assert failed.step_error == told, "a job that failed does not say why the run broke"


def test_a_night_that_was_refused_says_so_and_is_no_first_one_with_results() -> None:
    refused = StepRecord(name=BEFORE_STEPS, operation="RunPipeline", status="Failed", error="there is no such robot")
    night = make_night("", 0).model_copy(update={"state": "broken", "steps": [refused]})

    history = history_of("nightly", [NightRun.of(night)])

    told = "refused before its first step: there is no such robot"
    printed = "\n".join(history_lines(history, Path("page")))
    assert f"  The last run was {told}" in printed
    assert f"0  broken: {told}" in printed
    assert "first run" not in printed
    page = render_history(history, Path("page"))
    assert "1 run; the last one was refused before its first step" in page
    assert told in page
    assert "has results" not in page
    assert newest_lines({"nightly": history.nights[0]})[0].endswith(f"broken, {told}")
