"""Journal, tally and table of trials."""

from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from helpers.examples import examples
from helpers.variable_axes import variables
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.schemas.runs.trial_rows import MAX_FAILING, TrialRow, TrialsSummary
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.runtime.trials import completion
from prefect_robomaker.tasks.runtime.trials.completion import TrialJournal, read_journal, read_row, write_table
from prefect_robomaker.tasks.runtime.trials.tally import Tally

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text(max_size=20).filter(lambda text: text.isprintable())
NAMES = st.sampled_from(("goal", "clear", "fast"))
REQUIREMENTS = st.builds(Requirement, name=NAMES, satisfied=st.booleans(), detail=TEXTS, margin=st.none() | NUMBERS)


AXES: list[dict[str, Any]] = [
    {},
    {"axes": {**variables({"A": ["1", "2"]}), "mass": {"kind": "robot_mass", "values": [0.1 + 0.2, 1]}}},
    {
        "axes": {"mass": {"kind": "robot_mass", "range": [0.8, 1.2]}, **variables({"A": ["1"]})},
        "design": "random",
        "points": 5,
        "include": [{}, {"mass": 0.5}, {"mass": 2, "A": "1"}],
    },
]


@st.composite
def some_rows(draw: Any) -> tuple[Trials, list[TrialRow]]:
    """Rows of the first trials of a job."""
    trials = Trials.model_validate({"seeds": draw(st.integers(1, 3)), **draw(st.sampled_from(AXES))})
    rows = []
    for number in range(draw(st.integers(0, trials.count))):
        trial = trials.trial(number, 10)
        rows.append(
            TrialRow(
                trial=number,
                seed=trial.seed,
                axes=dict(trial.axes),
                verdict=draw(st.sampled_from(("PASS", "FAIL", "ERROR", "NONE"))),
                reason=draw(TEXTS),
                failure_code=draw(st.none() | st.just("RobotApplicationCrash")),
                ended_by=draw(st.none() | st.just("agent")),
                sim_time_s=draw(st.floats(0, 100)),
                wall_time_s=draw(st.floats(0, 100)),
                steps=draw(st.integers(0, 10**6)),
                requirements=draw(st.lists(REQUIREMENTS, max_size=3, unique_by=lambda each: each.name)),
                metrics=draw(st.dictionaries(st.sampled_from(("distance_m", "goals")), NUMBERS)),
                state_digest=draw(st.none() | st.just("ab" * 32)),
                looks=draw(st.integers(0, 100)),
                digest_until_s=draw(st.floats(0, 100)),
            )
        )
    return trials, rows


def keep(rows: list[TrialRow], path: Path) -> None:
    path.unlink(missing_ok=True)
    journal = TrialJournal(path, lambda row: None)
    for row in rows:
        journal.append(row)
    journal.close()


@examples(50, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(found=some_rows())
def test_rows_are_the_same_in_journal_and_table(found: tuple[Trials, list[TrialRow]], tmp_path: Path) -> None:
    trials, rows = found
    journal, path = tmp_path / "trials.jsonl", tmp_path / "trials.parquet"
    keep(rows, journal)

    assert list(read_journal(journal)) == rows
    assert write_table(journal, path, trials, {0}) == len(rows)
    assert [read_row(path, number) for number in range(len(rows))] == rows
    assert read_row(path, len(rows)) is None
    assert pq.read_table(path).column("recorded").to_pylist() == [number == 0 for number in range(len(rows))]


@examples(50, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(found=some_rows(), data=st.data())
def test_a_journal_that_was_cut_off_goes_on_after_its_last_whole_row(
    found: tuple[Trials, list[TrialRow]], data: Any, tmp_path: Path
) -> None:
    _, rows = found
    path = tmp_path / "trials.jsonl"
    keep(rows, path)
    whole = path.read_bytes()
    path.write_bytes(whole[: data.draw(st.integers(0, len(whole)))])
    left = path.read_bytes().count(b"\n")

    taken: list[TrialRow] = []
    journal = TrialJournal(path, taken.append)
    assert taken == rows[:left]
    assert journal.rows == left
    for row in rows[left:]:
        journal.append(row)
    journal.close()
    assert path.read_bytes() == whole


@examples(50)
@given(found=some_rows())
def test_the_job_is_judged_by_its_trials(found: tuple[Trials, list[TrialRow]]) -> None:
    trials, rows = found
    tally = Tally(trials)
    for row in rows:
        tally.take(row)
    result = tally.result("environment" if tally.is_whole else "duration limit", 10, {}, [])
    summary = TrialsSummary.of(result)

    assert summary is not None
    verdicts = [row.verdict for row in rows]
    counts = summary.counts
    assert [counts.passed, counts.failed, counts.errors, counts.unjudged] == [
        verdicts.count(each) for each in ("PASS", "FAIL", "ERROR", "NONE")
    ]
    if "FAIL" in verdicts:
        assert result.verdict == "FAIL"
    elif "ERROR" in verdicts or len(rows) < trials.count:
        assert result.verdict == "ERROR"
    else:
        assert result.verdict == ("PASS" if "PASS" in verdicts else "NONE")
    assert [each.trial for each in summary.failing] == [row.trial for row in rows if row.verdict in ("FAIL", "ERROR")]
    assert summary.stopped_in == (None if len(rows) == trials.count else len(rows))
    assert (result.reason is None) == (result.verdict in ("PASS", "NONE"))
    if trials.axes and trials.design == "grid":
        assert sum(each.total for each in summary.cells) == len(rows)
    for name in trials.axes or {}:
        assert sum(each.total for each in summary.axes if each.axis == name) == len(rows)


def test_what_the_job_switched_off_is_told_beside_its_trials() -> None:
    tally = Tally(Trials(seeds=2))
    quick = Requirement(name="quick", kind="time_limit", satisfied=True, detail="in time")
    rooms = Requirement(
        name="rooms", kind="off", satisfied=False, detail="switched off by the job: 1 of 2", counts=False
    )
    for number in range(2):
        tally.take(TrialRow(trial=number, seed=number, verdict="PASS", requirements=[quick, rooms]))
    result = tally.result("environment", 0, {}, [])
    assert result.verdict == "PASS"
    assert result.notes == ["switched off by the job: rooms"]
    [off] = [item for item in result.requirements if item.kind == "off"]
    assert (off.satisfied, off.detail) == (False, "switched off by the job; met in 0 of 2 trials")


def test_a_note_that_several_trials_have_is_one_line_with_their_numbers() -> None:
    tally = Tally(Trials(seeds=30))
    for number in range(30):
        notes = ["off", *(["odd"] if number % 2 else []), *(["one"] if number == 4 else [])]
        tally.take(TrialRow(trial=number, seed=number, verdict="PASS", notes=notes))
    assert tally.result("environment", 0, {}, []).notes == [
        "all 30 trials: off",
        "trials 1, 3, 5, 7, 9, 11, 13, 15, 17, 19 and 5 more: odd",
        "trial 4: one",
    ]


def test_a_defect_of_a_trial_stays_one_in_the_result_of_its_job() -> None:
    """Nights are compared by what was asked for, and no defect was."""
    fell = Requirement(name="above_floor", kind="health", satisfied=False, detail="it fell")
    tally = Tally(Trials(seeds=1))
    tally.take(TrialRow(trial=0, seed=0, verdict="FAIL", requirements=[fell]))
    told = {item.name: item for item in tally.result("environment", 0, {}, []).requirements}
    assert (told["above_floor"].kind, told["above_floor"].counts) == ("health", False)


def test_the_summary_stays_small_however_many_trials_fail() -> None:
    trials = Trials(seeds=5000)
    tally = Tally(trials)
    for number in range(trials.count):
        tally.take(TrialRow(trial=number, seed=number, verdict="FAIL", reason="x" * 2000))
    result = tally.result("environment", 0, {}, [])
    assert len(result.extra["trials"]["failing"]) == MAX_FAILING
    assert result.reason == "trials: 5000 of 5000 trials did not pass"
    assert len(result.model_dump_json()) < 100_000


def test_the_trials_that_did_not_pass_are_listed_where_others_passed() -> None:
    missed = Requirement(name="polite", satisfied=False, detail="1.2 m away")
    told = []
    for passed in (1, 0):
        tally = Tally(Trials(seeds=14))
        for number in range(14):
            row = {"verdict": "PASS"} if number < passed else {"verdict": "FAIL", "requirements": [missed]}
            tally.take(TrialRow.model_validate({"trial": number, "seed": number, **row}))
        told.append(tally.result("environment", 0, {}, []).reason)
    assert told == [
        "trials: 13 of 14 trials did not pass: trials 1, 2, 3, 4, 5, 6, 7, 8, 9, 10 and 3 more; missed: polite in 13",
        "trials: 14 of 14 trials did not pass; missed: polite in 14",
    ]


@pytest.mark.parametrize(("every", "told"), [(3, "2 broke, first trial 3: the rope"), (9, "trial 3 broke: the rope")])
def test_several_trials_that_broke_are_counted(every: int, told: str) -> None:
    missed = Requirement(name="polite", satisfied=False, detail="1.2 m away")
    tally = Tally(Trials(seeds=8))
    for number in range(8):
        row: dict[str, Any] = {"verdict": "PASS"}
        if number in (1, 5):
            row = {"verdict": "FAIL", "requirements": [missed]}
        elif number == 3 or number == 3 + every + 1:
            row = {"verdict": "ERROR", "reason": "the rope\nof line 2"}
        tally.take(TrialRow.model_validate({"trial": number, "seed": number, **row}))
    result = tally.result("environment", 0, {}, [])
    assert result.verdict == "FAIL"
    assert (result.reason or "").endswith(f"; missed: polite in 2; {told}")


def test_rows_lie_in_groups(tmp_path: Path) -> None:
    trials = Trials(seeds=2 * completion.ROWS_IN_GROUP + 1)
    rows = [TrialRow(trial=number, seed=number, verdict="PASS") for number in range(trials.count)]
    keep(rows, tmp_path / "trials.jsonl")
    write_table(tmp_path / "trials.jsonl", tmp_path / "trials.parquet", trials, set())
    assert pq.ParquetFile(tmp_path / "trials.parquet").num_row_groups == 3
    for number in (0, completion.ROWS_IN_GROUP - 1, completion.ROWS_IN_GROUP, trials.count - 1):
        assert read_row(tmp_path / "trials.parquet", number) == rows[number]


def test_something_else_is_no_table(tmp_path: Path) -> None:
    (tmp_path / "trials.parquet").write_bytes(b"PAR1 but not really")
    with pytest.raises(ValueError, match="is no table of trials"):
        read_row(tmp_path / "trials.parquet", 0)


@pytest.mark.parametrize(
    ("missed", "shown"),
    [
        ({}, (None, None)),
        ({"value": 1.2, "limit": 0.5, "margin": -0.7, "unit": "m"}, (-0.7, "m")),
    ],
)
def test_the_entry_of_a_requirement_that_a_trial_missed_has_the_margin_of_that_trial_or_none(
    missed: dict[str, Any], shown: tuple[float | None, str | None]
) -> None:
    """A goal that is reached has seconds left; one that is not lacks metres, or nothing that was measured."""
    tally = Tally(Trials(seeds=2))
    for number, requirement in enumerate((
        Requirement(name="goal", kind="goal", satisfied=True, detail="", value=33.0, limit=40.0, margin=7.0, unit="s"),
        Requirement(name="goal", kind="goal", satisfied=False, detail="", **missed),
    )):  # fmt: skip
        verdict = "PASS" if requirement.satisfied else "FAIL"
        tally.take(TrialRow(trial=number, seed=number, verdict=verdict, sim_time_s=1, wall_time_s=1, steps=1,
                            requirements=[requirement]))  # fmt: skip
    entry = tally.result("environment", 1, {}, []).requirements[1]
    assert (entry.satisfied, entry.margin, entry.unit) == (False, *shown)
