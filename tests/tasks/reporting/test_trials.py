"""Trials in reports: the pass rate with its interval, the failing ones, and how large a page becomes."""

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from helpers.variable_axes import trials_of_variables

from prefect_robomaker.schemas.reports.report import Report, ReportedJob, ReportedStep, Share
from prefect_robomaker.schemas.runs.plan import Requirement, RunResult, Verdict
from prefect_robomaker.schemas.runs.trial_rows import TrialRow
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.reporting import markdown_report, render_report, summarize
from prefect_robomaker.tasks.reporting.answer import answer_of
from prefect_robomaker.tasks.reporting.worlds import MOST_SHOWN, view_trials
from prefect_robomaker.tasks.results.rates import wilson_interval
from prefect_robomaker.tasks.runtime.trials.tally import Tally

START = datetime(2026, 3, 2, 9, 30, tzinfo=UTC)
VERDICTS: dict[str, Verdict] = {"P": "PASS", "F": "FAIL", "E": "ERROR", "N": "NONE"}


def result(trials: Trials, every: int) -> RunResult:
    """The result of a job of which every so manieth trial fails."""
    tally = Tally(trials)
    for number in range(trials.count):
        trial = trials.trial(number, 7)
        is_bad = number % every == 3
        asked = Requirement(
            name="clear", satisfied=not is_bad, detail="0.02 m", margin=-0.1 if is_bad else 0.2, unit="m"
        )
        row = TrialRow(trial=number, seed=trial.seed, axes=dict(trial.axes), requirements=[asked],
                       verdict="FAIL" if is_bad else "PASS", reason="clear: 0.02 m, 0.1 m <asked>" if is_bad else "",
                       metrics={"distance_m": 3.0})  # fmt: skip
        tally.take(row)
    return tally.result("environment", 7, {}, [3])


def report(*results: RunResult) -> Report:
    jobs = [
        ReportedJob(label=f"sim-{number}", arn=f"arn:{number}", status="Completed", step="drive", seed=7, result=each)
        for number, each in enumerate(results)
    ]
    step = ReportedStep(name="drive", operation="StartSimulationJobBatch", status="Completed", duration_s=9.0)
    return Report(name="trials", run_id="r", state="failed", started_at=START, ended_at=START + timedelta(seconds=9),
                  steps=[step], worlds=[], jobs=jobs, command="robomaker run trials.yaml")  # fmt: skip


def test_axes_of_a_single_value_are_in_no_table() -> None:
    made = report(result(trials_of_variables(10, {"SPEED": ["0.2", "0.4"], "LIMIT": ["9"]}), 5))
    [view] = [view_trials(job) for job in made.jobs]
    assert view is not None
    assert [share.name for share in view.axes] == ["SPEED 0.2", "SPEED 0.4"]


def test_a_card_shows_the_pass_rate_and_the_failing_trials(tmp_path: Path) -> None:
    made = report(result(trials_of_variables(50, {"SPEED": ["0.2", "0.4"]}), 10))
    page = render_report(made)
    (tmp_path / "report.html").write_text(page)

    low, high = wilson_interval(90, 100)
    assert "90 of 100 trials passed" in page
    assert f"95&nbsp;% interval {100 * low:.1f} to {100 * high:.1f}&nbsp;%" in page
    assert "SPEED=0.4" in page
    assert "clear: 0.02 m, 0.1 m &lt;asked&gt;" in page
    assert 'robomaker repro sim-0 <span class="whole">--trial 3</span>' in page, "no line breaks inside of --trial"
    [suite] = summarize(made).steps
    share = suite.jobs[0].trials
    assert share is not None
    assert (share.passed, share.failed, share.low, share.high) == (90, 10, low, high)


def mixed(letters: str) -> RunResult:
    """The result of a job whose trials have the verdicts that begin with these letters."""
    tally = Tally(Trials(seeds=len(letters)))
    for number, letter in enumerate(letters):
        reason = "" if letter == "P" else "rope"
        tally.take(TrialRow(trial=number, seed=number, verdict=VERDICTS[letter], reason=reason))
    return tally.result("environment", 7, {}, [])


@pytest.mark.parametrize(
    ("verdicts", "told"),
    [
        ("PPPPFFEE", "4 of 6 judged trials passed: 66.7&nbsp;%, 95&nbsp;% interval 30.0 to 90.3&nbsp;%; 2 broke"),
        ("PFN", "1 of 2 judged trials passed: 50.0&nbsp;%, 95&nbsp;% interval 9.5 to 90.5&nbsp;%; 1 without a verdict"),
        ("EE", "0 of 2 trials passed; 2 broke"),
    ],
)
def test_a_rate_says_of_how_many_it_is(verdicts: str, told: str) -> None:
    page = render_report(report(mixed(verdicts)))
    [line] = re.findall(r'<p class="small trials">(.*?)</p>', page)
    assert re.sub("</?strong>", "", line) == told


def test_trials_that_broke_stand_beside_those_that_passed() -> None:
    made = report(mixed("PFEE"))
    share = Share(name="", passed=9, failed=3, errors=4, rate=0.75, low=0.47, high=0.91)
    numbers = summarize(made).model_copy(update={"trials": 16, "success": share})
    assert answer_of(made, numbers).startswith("0 of 1 job passed; 1 failed (9 of 16 trials passed, 4 broke)")
    text = markdown_report(numbers)
    assert "0 of 1 job passed (9 of 16 trials passed, 4 broke)" in text
    assert "success rate 75 % of 12 judged (95 %: 47 to 91 %)" in text


def test_a_card_says_how_many_trials_ran_and_not_how_one_run_ended() -> None:
    ran = mixed("PF")
    assert "ran 2 trials · seed 7" in render_report(report(ran))
    assert "ended by" not in render_report(report(ran))
    tally = Tally(Trials(seeds=3))
    tally.take(TrialRow(trial=0, seed=0, verdict="PASS"))
    assert "ended by duration limit · seed 7" in render_report(report(tally.result("duration limit", 7, {}, [])))


def test_the_trial_with_the_smallest_margin_is_named_when_all_pass() -> None:
    tally = Tally(trials_of_variables(2, {"SPEED": ["0.2", "0.4"]}))
    for number, margin in enumerate((0.2, 0.3, 0.028817, 0.2)):
        asked = Requirement(
            name="polite", kind="clearance", satisfied=True, detail="far", value=0.3, margin=margin, unit="m"
        )
        tally.take(TrialRow(trial=number, seed=number, verdict="PASS", requirements=[asked]))
    made = tally.result("environment", 7, {}, [])
    assert made.requirements[1].trial == 2
    text = re.sub(r"<[^>]*>", "", render_report(report(made)))
    assert "met in 4 of 4 trials (smallest margin 0.029 m, trial 2: robomaker repro sim-0 --trial 2)" in text


def test_a_card_of_trials_sets_aside_only_what_is_off() -> None:
    trials = trials_of_variables(2, {"SPEED": ["0.2", "0.4"]})
    tally = Tally(trials)
    off = Requirement(name="rooms", kind="off", satisfied=False, detail="off: 1 of 2", counts=False)
    early = Requirement(name="visits", satisfied=False, detail="the goals ended the run", counts=False)
    own = Requirement(name="gentle", kind="no_collision", satisfied=True, detail="0 N")
    for number in range(4):
        asked = [off, early, own.model_copy(update={"satisfied": number > 0})]
        tally.take(TrialRow(trial=number, seed=number, verdict="FAIL" if not number else "PASS", requirements=asked))
    page = render_report(report(tally.result("environment", 7, {}, [])))
    listed = re.findall(r'<li class="([a-z ]+)">.*?<strong>([^<]*)</strong> (.*?)</span></li>', page)
    assert [
        (key, name, "does not count" in text) for key, name, text in listed if name in ("gentle", "rooms", "visits")
    ] == [
        ("failed", "gentle", False),
        ("unjudged aside", "rooms", True),
        ("unjudged aside", "visits", True),
    ]


def test_columns_in_which_no_job_has_a_number_are_left_out_and_cards_of_trials_are_stacked() -> None:
    made = result(trials_of_variables(2, {"SPEED": ["0.2", "0.4"]}), 10)
    page = render_report(report(made, made))
    table = page.partition('id="table"')[2].partition("</table>")[0]
    heads = re.findall(r'<th scope="col"[^>]*>([^<]*?) ?(?:<span|</th>)', table)
    assert "Wall time" in heads
    assert not {"Rooms visited", "Collisions", "Largest force"} & set(heads)
    assert {table.count(f'data-label="{each}"') for each in heads[1:]} == {2}, "one cell of each job under each head"
    assert page.count(" bare of-trials") == 2


def test_a_card_has_a_rate_for_each_part_of_each_axis() -> None:
    axes = {
        "mass": {"kind": "robot_mass", "range": [0.5, 1.5]},
        "noise": {"kind": "lidar_noise_std_m", "values": [0, 0.01]},
    }
    drawn = {"axes": axes, "design": "sobol", "points": 40, "include": [{}, {"mass": 2}]}
    trials = Trials.model_validate({"seeds": 1, **drawn})
    made = result(trials, 4)
    page = render_report(report(made))

    parts = ["0.5 to 0.7", "0.7 to 0.9", "0.9 to 1.1", "1.1 to 1.3", "1.3 to 1.5", "above 1.5", "as built"]
    places = [page.index(f'<th scope="row">mass {part}</th>') for part in parts]
    assert places == sorted(places)
    in_part = [number for number in range(40) if 0.5 <= trials.trial(number, 7).axes["mass"] < 0.7]  # type: ignore
    passed = sum(number % 4 != 3 for number in in_part)
    low, high = wilson_interval(passed, len(in_part))
    row = page[places[0] : places[1]]
    assert f'data-label="Passed">{passed}<' in row
    assert f"{100 * low:.0f}" in row
    assert f"{100 * high:.0f}" in row
    assert '<th scope="row">noise 0.01</th>' in page
    assert f"mass={trials.trial(3, 7).axes['mass']:.6g}" in page  # of the first that fails


def test_cells_of_a_grid_of_several_axes_are_shown_worst_first() -> None:
    both = trials_of_variables(6, {"SPEED": ["1", "2"], "LOAD": ["a", "b"]})
    page = render_report(report(result(both, 20)))
    cells = ["SPEED=1, LOAD=a", "SPEED=2, LOAD=b"]  # trials 3 and 23 fail
    others = ["SPEED=1, LOAD=b", "SPEED=2, LOAD=a"]
    places = [page.index(f'<th scope="row">{cell}</th>') for cell in (*cells, *others)]
    assert max(places[:2]) < min(places[2:])
    assert '<th scope="row">LOAD b</th>' in page
    assert "Cells" not in render_report(report(result(trials_of_variables(6, {"SPEED": ["1", "2"]}), 20)))


def test_a_job_without_trials_has_none() -> None:
    plain = RunResult(verdict="PASS", sim_time_s=1.0, wall_time_s=1.0, real_time_factor=1.0, ended_by="agent", seed=1)
    assert "trials" not in render_report(report(plain)).partition("<article")[2]
    assert summarize(report(plain)).steps[0].jobs[0].trials is None


def test_a_card_names_some_and_says_how_many_more() -> None:
    page = render_report(report(result(Trials(seeds=1000), 4)))
    assert f"{250 - MOST_SHOWN} more did not pass" in page


def test_a_report_grows_with_its_jobs_and_hardly_with_their_trials() -> None:
    few = render_report(report(*(result(Trials(seeds=500), 5) for _ in range(4))))
    more = render_report(report(*(result(Trials(seeds=1_000), 5) for _ in range(4))))
    many = render_report(report(*(result(Trials(seeds=50), 5) for _ in range(20))))
    assert len(more.encode()) < len(few.encode()) + 1_000
    assert len(few.encode()) < 100_000
    assert len(many.encode()) < 10_000 * 20


@pytest.mark.deep
def test_the_report_of_100_000_trials_stays_small() -> None:
    few = render_report(report(*(result(Trials(seeds=25_000), 5) for _ in range(4))))
    many = render_report(report(*(result(Trials(seeds=100), 5) for _ in range(1000))))
    assert len(few.encode()) < 300_000
    assert len(many.encode()) < 10_000_000
