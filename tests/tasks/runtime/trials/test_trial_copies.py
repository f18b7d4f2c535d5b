"""Trials of a job that repeat each other to the bit: counted in its summary, and left out of its intervals."""

from helpers.variable_axes import variables

from prefect_robomaker.schemas.reports.report import ReportedJob
from prefect_robomaker.schemas.runs.trial_rows import TrialRow
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.reporting.worlds import view_trials
from prefect_robomaker.tasks.results.rates import wilson_interval
from prefect_robomaker.tasks.runtime.trials.tally import Tally


def test_trials_that_repeat_others_are_left_out_of_the_intervals_of_the_job_its_axes_and_cells() -> None:
    """The seed changes nothing: each value of SPEED was tried once, not three times."""
    trials = Trials.model_validate({"seeds": 3, "axes": {**variables({"SPEED": ["1", "2"], "MODE": ["a", "b"]})}})
    tally = Tally(trials)
    for number in range(trials.count):
        trial = trials.trial(number, 10)
        axes = dict(trial.axes)
        tally.take(
            TrialRow(trial=number, seed=trial.seed, axes=axes, verdict="PASS", state_digest=str(sorted(axes.items())))
        )
    job = ReportedJob(label="sim-1", status="Completed", result=tally.result("environment", 10, {}, []))

    view = view_trials(job)

    assert view is not None
    assert (view.share.passed, view.share.copies) == (12, 8)
    assert (view.share.low, view.share.high) == wilson_interval(4, 4)
    assert [each.copies for each in view.axes] == [4] * 4
    assert [each.copies for each in view.cells] == [2] * 4
    assert view.cells[0].remark == "2 copies not counted"
