"""The table of results: each job and each trial once, in every sum."""

from pathlib import Path

import pytest
from helpers.night_records import make_job, make_night, trials_of
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.run_record import JobRecord
from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.comparison.better_or_worse import compare
from prefect_robomaker.tasks.comparison.compared_runs import NightRun
from prefect_robomaker.tasks.comparison.history import history_of
from prefect_robomaker.tasks.results import rates
from prefect_robomaker.tasks.results.table import RESULTS_FILE, ResultTable

LETTERS = {"P": "passed", "F": "failed", "E": "broken", "C": "canceled", "N": "no verdict"}
NIGHTS = st.lists(st.one_of(st.sampled_from(list("PFECN")), st.text("PFEN", min_size=1, max_size=6)), max_size=8)


def jobs_of(night: list[str], number: int = 0) -> tuple[list[JobRecord], ResultTable]:
    """Jobs: a letter is one without trials, a text one with a trial each."""
    jobs = [make_job(index, each[0], night=number, world="ab"[index % 2]) for index, each in enumerate(night)]
    tables = {job.label: trials_of(each) for job, each in zip(jobs, night, strict=True) if len(each) > 1}
    own = [Requirement(name="trials", satisfied=True, detail="")]
    jobs = [
        job.model_copy(update={"status": "Completed", "failure_code": None, "verdict": "FAIL", "requirements": own})
        if job.label in tables
        else job
        for job in jobs
    ]
    return jobs, ResultTable.of(jobs, lambda job: tables.get(job.label))


@given(NIGHTS)
def test_every_trial_is_counted_once(night: list[str]) -> None:
    letters = [LETTERS[letter] for each in night for letter in each]
    _, results = jobs_of(night)
    assert results.texts("outcome") == letters
    of_all = rates.of_table("", results)
    assert [of_all.passed, of_all.failed, of_all.errors] == [
        letters.count(each) for each in ("passed", "failed", "broken")
    ]
    for counts in (rates.by_world(results), list(rates.counts_by(results, "job").values())):
        assert sum(each.passed + each.failed + each.errors for each in counts) == (
            of_all.passed + of_all.failed + of_all.errors
        )
    assert sum(each.passed for each in rates.by_requirement(results) if each.name == "gentle") == of_all.passed


@given(first=NIGHTS, second=NIGHTS)
def test_comparison_and_history_count_the_same(
    first: list[str], second: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    runs = tmp_path_factory.mktemp("runs")
    nights = []
    for number, night in enumerate((first, second)):
        jobs, results = jobs_of(night, number)
        record = make_night(jobs, number, runs=runs)
        record.run_dir.mkdir(parents=True)
        results.write(record.run_dir / RESULTS_FILE)
        nights.append(NightRun.of(record))
    found, history = compare(*nights), history_of("nightly", nights)
    assert found.trials + found.trials_only_before == sum(map(len, first))
    assert found.trials + found.trials_only_after == sum(map(len, second))
    assert found.pairs + found.only_after == len(second)
    for night, letters in zip(history.nights, ("".join(first), "".join(second)), strict=True):
        assert [night.success.passed, night.success.failed, night.success.errors] == [
            letters.count(each) for each in "PFE"
        ]


def test_a_job_that_broke_between_two_trials_is_counted_beside_them() -> None:
    broken = make_job(0, "E")
    results = ResultTable.of([broken], lambda job: trials_of("PPF"))
    assert results.texts("outcome") == ["passed", "passed", "failed", "broken"]
    assert rates.of_table("", results).errors == 1
    in_a_trial = ResultTable.of([broken], lambda job: trials_of("PPE"))
    assert rates.of_table("", in_a_trial).errors == 1


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    jobs, results = jobs_of(["PFE", "C", "PP"])
    results.write(tmp_path / RESULTS_FILE)
    read = ResultTable.read(tmp_path / RESULTS_FILE)
    assert [path.name for path in tmp_path.iterdir()] == [RESULTS_FILE]
    for column in ("job", "test", "step", "world", "world_name", "outcome", "output", "reason", "requirements"):
        assert read.texts(column) == results.texts(column)
    assert read.requirements_at(1) == make_job(0, "F").requirements
    assert [read.rows_of(job) for job in jobs] == [range(3), range(3, 4), range(4, 6)]
    assert read.met("gentle").tolist() == [1, 0, -1, -1, 1, 1]
    assert read.met("unheard of").tolist() == [-1] * 6


def test_a_job_without_trials_says_what_ended_it() -> None:
    ended = make_job(0, "F").model_copy(update={"ended_by": "duration limit"})
    assert ResultTable.of([ended, make_job(1, "P")]).texts("ended_by") == ["duration limit", None]


def test_requests_of_several_steps_that_became_no_job_are_told_apart() -> None:
    lost = make_job(0, "E").model_copy(update={"label": "request 1", "status": "NotCreated"})
    other = lost.model_copy(update={"step": "push"})
    results = ResultTable.of([lost, other])
    assert [results.rows_of(job) for job in (lost, other)] == [range(1), range(1, 2)]


@pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1 but not really PAR1"])
def test_other_files_are_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / RESULTS_FILE).write_bytes(content)
    with pytest.raises(ValueError, match="is no table of results"):
        ResultTable.read(tmp_path / RESULTS_FILE)
    with pytest.raises(FileNotFoundError):
        ResultTable.read(tmp_path / "other.parquet")


def test_a_damaged_page_is_told_when_the_table_is_opened(tmp_path: Path) -> None:
    _, results = jobs_of(["PFPFPF" * 50, "P"])
    results.write(tmp_path / RESULTS_FILE)
    content = bytearray((tmp_path / RESULTS_FILE).read_bytes())
    content[100:600] = bytes(500)
    (tmp_path / RESULTS_FILE).write_bytes(content)
    with pytest.raises(ValueError, match=r"results\.parquet is damaged"):
        ResultTable.read(tmp_path / RESULTS_FILE)


def test_of_two_requirements_of_one_name_the_missed_one_counts() -> None:
    job = make_job(0, "F")
    met = job.requirements[0].model_copy(update={"satisfied": True, "margin": 1.0})
    for requirements in ([met, *job.requirements], [*job.requirements, met]):
        results = ResultTable.of([job.model_copy(update={"requirements": requirements})])
        assert results.met("gentle").tolist() == [0]
        assert results.numbers("margin.gentle").tolist() == [-4.0]


def test_no_requirement_of_a_night_is_left_out_however_many_there_are() -> None:
    jobs = [
        job.model_copy(update={"requirements": [job.requirements[0].model_copy(update={"name": f"r{number}"})]})
        for number, job in enumerate(make_job(index, "F") for index in range(300))
    ]
    assert len(rates.by_requirement(ResultTable.of(jobs))) == 300


def test_rows_say_the_values_of_their_steps_axes() -> None:
    cells = ({"robot": "scout", "speed": 0.5}, {"robot": "rover", "speed": 1.0}, {})
    jobs = [make_job(index, "P").model_copy(update={"axes": axes}) for index, axes in enumerate(cells)]

    table = ResultTable.of(jobs)

    assert table.values("robot") == ["scout", "rover", None]
    assert table.values("speed") == [0.5, 1.0, None]


def test_trials_have_the_axes_of_their_jobs_step_and_their_own() -> None:
    job = make_job(0, "P").model_copy(update={"axes": {"robot": "scout"}})

    table = ResultTable.of([job], lambda _: trials_of("PF", axes={"SPEED": "2"}))

    assert (table.values("robot"), table.values("SPEED")) == (["scout"] * 2, ["2"] * 2)


def test_axes_of_one_name_with_numbers_and_texts_are_texts() -> None:
    """A table of which two parts have columns of two types cannot be made, and the run would have no report."""
    first, second, third = (
        make_job(index, "P").model_copy(update={"axes": axes})
        for index, axes in enumerate(({"speed": 0.5}, {"speed": "fast"}, {"speed": 2.0}))
    )

    table = ResultTable.of([first, second, third], lambda job: trials_of("P") if job is third else None)

    assert table.values("speed") == ["0.5", "fast", "2"]
