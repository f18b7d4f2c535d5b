"""Nights that judge less than earlier ones: what is gone, no longer judged or asked less is named, once, everywhere."""

from pathlib import Path
from typing import Any

import pytest
from helpers.night_records import make_job, make_night, make_trials_night, store_night

from prefect_robomaker.deployments.cli.output.comparison import changed_lines, comparison_lines, history_lines
from prefect_robomaker.schemas.reports.changes import Loss, Losses
from prefect_robomaker.schemas.reports.run_record import JobRecord, RerunOf, RunRecord
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.schemas.settings import NotifyWhen
from prefect_robomaker.tasks.comparison.better_or_worse import compare
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.history import history_of, since_last_good_run, since_last_run
from prefect_robomaker.tasks.inspection.run_records import since_last_good
from prefect_robomaker.tasks.notifications.notices import is_due
from prefect_robomaker.tasks.notifications.notification_texts import Message, message_of
from prefect_robomaker.tasks.reporting import render_history
from prefect_robomaker.tasks.reporting.nights.changes import losses_in_words

USUAL: frozenset[NotifyWhen] = frozenset({"failure", "recovery"})


def night_of(number: int, *jobs: JobRecord, **members: Any) -> RunRecord:
    return make_night(list(jobs), number).model_copy(update=members)


def jobs(letters: str, night: int = 0, **members: Any) -> list[JobRecord]:
    """Jobs of one application with seeds from 1, as of requests without worlds."""
    return [
        make_job(index, each, night=night, world=None, seed=index + 1, **members)
        for index, each in enumerate(letters)
        if each != "-"
    ]


def asked(job: JobRecord, *names: str, **members: Any) -> JobRecord:
    """The job, judged by requirements of these names."""
    said = {"satisfied": True, "detail": "", "kind": "goal", **members}
    return job.model_copy(update={"requirements": [Requirement(name=each, **said) for each in names]})


def nights(*letters: str) -> list[RunRecord]:
    """Runs with the jobs of these letters; `-` is a job that the specification does not have."""
    states = {"F": "failed", "E": "broken", "C": "canceled"}
    return [
        night_of(
            number,
            *jobs(each, number),
            state=next((state for letter, state in states.items() if letter in each), "succeeded"),
        )
        for number, each in enumerate(letters)
    ]


def lost(records: list[RunRecord]) -> Losses:
    return since_last_run([NightRun.of(each) for each in records])


def told(records: list[RunRecord]) -> Message:
    since = since_last_good_run([NightRun.of(each) for each in records])
    return message_of(records[-1], records[-2], since)


def test_a_job_that_vanished_is_gone() -> None:
    found = lost(nights("PPF", "PP-"))
    assert [(each.cell.title, each.job, each.before) for each in found.gone] == [
        ("drive: request 3 scout, seed 3", "sim-0-2", "failed")
    ]
    assert found.no_longer_judged == found.asked_less == []
    assert losses_in_words(found) == [
        "1 job is gone, since drive has 2 seeds instead of 3: drive: request 3 scout, seed 3 (failed before)"
    ]


@pytest.mark.parametrize(
    ("letters", "gone", "unjudged"),
    [
        (("PPF", "PPN"), 0, 1),
        (("PPF", "NNN"), 0, 3),
        (("PPF", "---"), 3, 0),
        (("PPF", "PP-", "PP-"), 0, 0),  # told the night before
        (("PPF", "PPN", "PPN"), 0, 0),
        (("PPF", "PPE", "PPN"), 0, 1),  # a crash between has no verdict
        (("PPN", "PPE", "PPN"), 0, 0),  # it never had one
        (("PPF", "CC-", "PP-"), 0, 0),  # a cancelled run that has jobs of the step says so itself
        (("PPF", "CCC", "PP-"), 1, 0),
        (("PPC", "PP-"), 0, 0),  # it never had a result
        (("PPF", "PP-", "PPP"), 0, 0),
        (("PPF", "PPE"), 0, 0),
        (("PPF", "PPC"), 0, 0),
    ],
)
def test_each_loss_is_told_once(letters: tuple[str, ...], gone: int, unjudged: int) -> None:
    found = lost(nights(*letters))
    assert (len(found.gone), len(found.no_longer_judged)) == (gone, unjudged)


@pytest.mark.parametrize("state", ["broken", "canceled", "timed out"])
def test_a_run_that_ended_before_a_step_lost_nothing(state: str) -> None:
    """Its state and the step's say so; the next run that comes so far is compared."""
    before, early = nights("PPF")[0], night_of(1, state=state)
    assert not lost([before, early]).has_losses
    after = night_of(2, *jobs("PP-", 2))
    assert len(lost([before, early, after]).gone) == 1


def test_other_worlds_every_night_are_not_gone() -> None:
    def night(number: int, count: int, names: int = 0) -> RunRecord:
        made = [make_job(names + index, "P", night=number, world=f"{number} {index}") for index in range(count)]
        return night_of(number, *made)

    assert not lost([night(0, 3), night(1, 3)]).has_losses
    assert not lost([night(0, 3), night(1, 4)]).has_losses
    fewer = lost([night(0, 5), night(1, 3)])
    assert [each.cell.test for each in fewer.gone] == ["world-4 scout", "world-5 scout"]
    assert not lost([night(0, 3), night(1, 3, names=9)]).has_losses, "as many of other names"
    assert len(lost([night(0, 3), night(1, 2, names=9)]).gone) == 3, "which of them were replaced is not known"


def test_a_job_whose_inputs_are_not_known_may_be_the_one_that_is_missed() -> None:
    unknown = jobs("P", 1)[0].model_copy(update={"inputs": None})
    assert not lost([night_of(0, *jobs("P")), night_of(1, unknown)]).has_losses


def test_a_requirement_that_is_not_asked_any_more_is_named() -> None:
    (first,), (second,) = jobs("P"), jobs("P", 1)
    found = lost([night_of(0, asked(first, "east", "north")), night_of(1, asked(second, "north"))])
    assert losses_in_words(found) == [
        "1 job is asked less than before: drive: request 1 scout, seed 1 (passed before; requirement east is not asked "
        "any more)"
    ]
    bare = second.model_copy(update={"verdict": "NONE", "requirements": []})
    assert losses_in_words(lost([night_of(0, asked(first, "east", "north")), night_of(1, bare)])) == [
        "1 job is no longer judged: drive: request 1 scout, seed 1 (passed before; requirements east, north are not "
        "asked any more)"
    ]


def test_a_requirement_that_is_switched_off_is_not_asked_any_more_and_switching_it_on_again_is_no_loss() -> None:
    jobs_of_nights = [jobs("P", night)[0] for night in range(3)]
    on = [asked(each, "east", "rooms") for each in jobs_of_nights]
    rooms_off = Requirement(name="rooms", kind="off", satisfied=True, detail="switched off", counts=False)
    off = asked(jobs_of_nights[1], "east").model_copy(update={"verdict": "PASS"})
    off = off.model_copy(update={"requirements": [*off.requirements, rooms_off]})
    found = losses_in_words(lost([night_of(0, on[0]), night_of(1, off)]))
    assert len(found) == 1
    assert "requirement rooms is not asked any more" in found[0]
    assert losses_in_words(lost([night_of(1, off), night_of(2, on[2])])) == []


def test_requirements_that_broke_jobs_do_not_list_are_looked_for_in_the_run_before() -> None:
    (first,), (broken,), (last,) = jobs("P"), jobs("P", 1), jobs("P", 2)
    error = asked(broken, "fast", satisfied=False, error="no").model_copy(update={"verdict": "ERROR"})
    found = lost([night_of(0, asked(first, "east")), night_of(1, error), night_of(2, asked(last, "north"))])
    assert found.asked_less[0].requirements == ["east", "fast"]


def test_what_was_never_asked_for_and_what_does_not_count_is_no_loss() -> None:
    """`above_floor` is in a result only where it was missed; goals that end a run make the environment's not count."""
    (first,), (second,) = jobs("F"), jobs("P", 1)
    fell = first.model_copy(
        update={
            "requirements": [
                Requirement(name="above_floor", kind="health", satisfied=False, detail="it fell"),
                Requirement(name="rooms", satisfied=False, detail="1 of 3"),
            ]
        }
    )
    well = second.model_copy(
        update={"requirements": [Requirement(name="rooms", satisfied=False, detail="1 of 3", counts=False)]}
    )
    records = [night_of(0, fell), night_of(1, well)]
    assert not lost(records).has_losses
    assert since_last_run([NightRun.of(each) for each in records]).other_requirements == 0
    assert compare(*map(NightRun.of, records)).answer == "no difference shown"


def test_trials_are_asked_for_what_each_of_them_is_judged_by() -> None:
    (first,), (second,) = jobs("P"), jobs("P", 1)
    trials = Requirement(name="trials", satisfied=True, detail="9 of 9")
    east = Requirement(name="east", satisfied=True, detail="met in 9 of 9", counts=False)
    before = first.model_copy(update={"requirements": [trials, east]})
    after = second.model_copy(update={"requirements": [trials]})
    assert lost([night_of(0, before), night_of(1, after)]).asked_less[0].requirements == ["east"]
    assert not lost([night_of(0, before), night_of(1, before)]).has_losses


def with_trials(job: JobRecord, count: int, **members: Any) -> JobRecord:
    own = Requirement(name="trials", satisfied=True, detail=f"none of {count} trials failed")
    return job.model_copy(update={"requirements": [own], "metrics": {"trials": float(count)}, **members})


@pytest.mark.parametrize(
    ("counts", "found"),
    [
        ((20, 2), (20, 2)),
        ((2, 20), None),
        ((20, 20), None),
        ((20, 2, 2), None),  # told the night before
        ((20, 2, 1), (2, 1)),
        ((20, None, 2), (20, 2)),  # a crash between counts nothing
        ((20, None), None),
    ],
)
def test_fewer_trials_are_told_once_with_both_numbers(
    counts: tuple[int | None, ...], found: tuple[int, int] | None
) -> None:
    records = [
        night_of(night, jobs("E", night)[0] if count is None else with_trials(jobs("P", night)[0], count))
        for night, count in enumerate(counts)
    ]
    told_now = [(each.trials_before, each.trials_now) for each in lost(records).fewer_trials]
    assert told_now == ([found] if found else [])


def test_fewer_trials_are_named_everywhere_and_no_night_is_good_again() -> None:
    good, bad, fewer = (
        night_of(night, with_trials(jobs("P", night)[0], 2 if night == 2 else 20)) for night in range(3)
    )
    records = [good, bad.model_copy(update={"state": "failed"}), fewer]
    line = "1 job has fewer trials than before: drive: request 1 scout, seed 1 (passed before; 2 trials, 20 before)"
    since = lost(records)
    assert losses_in_words(since) == [line]
    message = told(records)
    assert (message.title, message.good) == ("nightly: passed, 1 of 1 job passed, 1 with fewer trials", False)
    assert line in message.body
    ran = [NightRun.of(each) for each in records]
    assert f"  {line}" in history_lines(history_of("nightly", ran), Path("page"))
    assert f"  {line}" in comparison_lines(compare(ran[1], ran[2]))
    page = render_history(history_of("nightly", ran), Path("runs"))
    assert "Fewer trials than before" in page
    assert "2 trials, 20 before" in page


def test_trials_that_are_judged_by_less_are_no_fair_pair() -> None:
    def night(number: int, *names: str) -> RunRecord:
        own = Requirement(name="trials", satisfied=True, detail="none of 9 trials failed")
        each = [
            Requirement(name=name, kind="goal", satisfied=True, detail="met in 9 of 9", counts=False) for name in names
        ]
        fell = Requirement(name="above_floor", kind="health", satisfied=False, detail="it fell", counts=False)
        (job,) = jobs("P", number)
        return night_of(number, job.model_copy(update={"requirements": [own, *each, *([fell] if number else [])]}))

    assert compare(*map(NightRun.of, (night(0, "east", "north"), night(1, "east")))).other_requirements == 1
    same = night(0, "east"), night(1, "east")
    assert compare(*map(NightRun.of, same)).other_requirements == 0
    assert not lost(list(same)).has_losses


def test_another_seed_in_the_place_of_one_that_failed_is_said() -> None:
    before, after = night_of(0, *jobs("PF"), state="failed"), night_of(1, jobs("P", 1)[0])
    other = make_job(1, "P", night=1, world=None, seed=9)
    after = after.model_copy(update={"jobs": [*after.jobs, other]})
    words = "1 job has no earlier result: new, or with another world or seed than before."
    assert words in told([before, after]).body
    history = history_of("nightly", [NightRun.of(before), NightRun.of(after)])
    assert f"  {words}" in history_lines(history, Path("page"))


@pytest.mark.parametrize(("now", "title"), [
    ("PP-", "nightly: passed, 2 of 2 jobs passed, 1 job gone"),
    ("PPN", "nightly: succeeded, 2 of 3 jobs passed, 1 without a verdict, 1 no longer judged"),
    ("NNN", "nightly: succeeded, 0 of 3 jobs passed, 3 without a verdict, 3 no longer judged"),
])  # fmt: skip
def test_a_night_that_shrinks_is_not_good_again(now: str, title: str) -> None:
    records = nights("PPF", now)
    message = told(records)
    assert (message.title, message.good) == (title, False)
    assert "drive: request 3 scout, seed 3 (failed before" in message.body
    since = lost(records)
    assert is_due(USUAL, records[1], records[0], since)
    change: frozenset[NotifyWhen] = frozenset({"change"})
    recovery: frozenset[NotifyWhen] = frozenset({"recovery"})
    assert is_due(change, records[1], records[0], since)
    assert not is_due(recovery, records[1], records[0], since)


def test_what_was_lost_in_a_bad_night_keeps_the_next_from_being_good_again() -> None:
    message = told(nights("PPF", "EP-", "PP-"))
    assert message.title == "nightly: passed, 2 of 2 jobs passed, 1 job gone"
    assert told(nights("PPF", "EP-", "PPP")).title == "nightly: passed, good again, 3 of 3 jobs passed"
    assert told(nights("PPP", "PP-", "PF-", "PP-")).title == "nightly: passed, good again, 2 of 2 jobs passed"


def test_the_end_of_a_run_says_what_newly_fails_and_what_changed_then(tmp_path: Path) -> None:
    """Also where no trial has its pair, as a value of an axis changed; of many jobs that are gone two are named."""

    def night(letters: str, number: int, delay: float) -> RunRecord:
        made = make_night(letters, number, runs=tmp_path, trials=str(delay))
        jobs = [job.model_copy(update={"requirements": []}) for job in made.jobs]
        return made.model_copy(update={"parameters": {"delay": delay}, "jobs": jobs})

    first, second = night("PPPPPPP", 0, 0), night("FFFP", 1, 0.6)
    store_night(first)
    *others, gone, failing, compare = changed_lines(second)
    assert others == []
    assert gone.startswith("3 jobs are gone, since drive has 4 worlds instead of 7: ")
    assert gone.endswith("; and 1 more")
    assert failing == f"newly failing 3 since {first.run_id} (changed: parameter delay: 0 → 0.6)"
    assert compare == f"better or worse: robomaker compare {first.run_id} {second.run_id}"


def test_reruns_and_probes_are_no_nights(tmp_path: Path) -> None:
    first, second = (each.model_copy(update={"run_dir": tmp_path / each.run_id}) for each in nights("PPF", "--P"))
    store_night(first)
    assert changed_lines(second) == ["gentle: newly met in 1 of 1 trial",
                                     "2 jobs are gone, since drive has 1 seed instead of 3: "
                                     "drive: request 1 scout, seed 1 (passed before); "
                                  "drive: request 2 scout, seed 2 (passed before)",
                                     f"better or worse: robomaker compare {first.run_id} {second.run_id}"]  # fmt: skip
    assert len(since_last_good(second).gone) == 2
    rerun = RerunOf(run_id=first.run_id, selection="failed", jobs_total=3, earlier={})
    assert changed_lines(second.model_copy(update={"rerun_of": rerun})) == []
    assert changed_lines(second.model_copy(update={"probe": True})) == []
    store_night(second.model_copy(update={"probe": True}))
    third = nights("PPF", "PPF", "PPF")[2].model_copy(update={"run_dir": tmp_path / "nightly-3"})
    assert not since_last_good(third).has_losses


@pytest.mark.parametrize("now", ["PP-", "PPN", "NNN"])
def test_commands_name_it(now: str) -> None:
    records = [NightRun.of(each) for each in nights("PPF", now)]
    printed = "\n".join(history_lines(history_of("nightly", records), Path("page")))
    compared = "\n".join(comparison_lines(compare(*records)))
    for text in (printed, compared):
        assert "drive: request 3 scout, seed 3" in text
        assert ("is gone, since drive has 2 seeds instead of 3: " if now == "PP-" else "no longer judged: ") in text
    assert "No job" not in printed


def test_the_cause_of_missing_jobs_is_said_with_its_parameter() -> None:
    """Six jobs of three seeds in two worlds; the next night has one world and two seeds, as its parameters say."""
    cells = [(world, seed) for world in ("a", "b") for seed in (1, 2, 3)]
    before, after = (
        night_of(
            number,
            *(make_job(index, "P", night=number, world=world, seed=seed) for index, (world, seed) in enumerate(some)),
            parameters=parameters,
        )
        for number, (some, parameters) in enumerate(
            ((cells, {"seeds": 3, "worlds": ["a", "b"]}), (cells[:2], {"seeds": 2, "worlds": ["a"]}))
        )
    )
    found = lost([before, after])
    assert [each.causes for each in found.gone] == [
        ["2 seeds instead of 3 (parameter seeds)"],
        ["1 world instead of 2 (parameter worlds)"],
        ["1 world instead of 2 (parameter worlds)"],
        ["2 seeds instead of 3 (parameter seeds)", "1 world instead of 2 (parameter worlds)"],
    ]
    example = (Loss.model_fields["causes"].description or "").split("`")[1]
    assert example.replace("20", "3") == found.gone[0].causes[0], "the description has other words"
    [line] = losses_in_words(found)
    assert line.startswith(
        "4 jobs are gone, since drive has 2 seeds instead of 3 (parameter seeds) and 1 world instead of 2 "
        "(parameter worlds): drive: world-3 scout, seed 3 (passed before); "
    )


def test_values_of_axes_that_are_missing_are_said_and_else_nothing() -> None:
    jobs = [
        make_job(index, "P", world=None, seed=1).model_copy(update={"axes": {"robot": robot}})
        for index, robot in enumerate(("rover", "scout"))
    ]
    found = lost([night_of(0, *jobs), night_of(1, jobs[0])])
    assert [each.causes for each in found.gone] == [["1 value of axis robot instead of 2"]]
    alone = lost([night_of(0, make_job(0, "P", seed=1)), night_of(1)])
    assert [each.causes for each in alone.gone] == [["no jobs"]]
    twice = [make_job(index, "P", world=None, seed=1) for index in range(2)]
    [unknown] = lost([night_of(0, *twice), night_of(1, twice[0])]).gone
    assert unknown.causes == []


def test_the_cause_of_fewer_trials_is_said(tmp_path: Path) -> None:
    nights = [
        make_trials_night([letters], number, runs=tmp_path).model_copy(update={"parameters": {"seeds": len(letters)}})
        for number, letters in enumerate(("PPPP", "PP"))
    ]
    for night in nights:
        night.jobs[0].metrics["trials"] = float(night.parameters["seeds"])
    [found] = lost(nights).fewer_trials
    assert (found.trials_before, found.trials_now) == (4, 2)
    assert found.causes == ["2 seeds instead of 4 (parameter seeds)"]
