"""An axis that changes nothing is told, also where it stands beside axes that do."""

from collections.abc import Callable, Mapping

from helpers.variable_axes import variables

from prefect_robomaker.schemas.runs.axis_kinds.kind import Value
from prefect_robomaker.schemas.runs.trial_rows import TrialRow
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.tasks.runtime.trials.tally import Tally

GRID = {"seeds": 3, "axes": {**variables({"SPEED": ["1", "2"], "UNREAD": ["a", "b"]})}}


def notes_of(states: Callable[[int, Mapping[str, Value]], str | None], spec: Mapping[str, object] = GRID) -> list[str]:
    """The remarks on trials that go through states that depend on their seed and their axes."""
    trials = Trials.model_validate(spec)
    tally = Tally(trials)
    for number in range(trials.count):
        trial = trials.trial(number, 10)
        row = TrialRow(
            trial=number,
            seed=trial.seed,
            axes=dict(trial.axes),
            verdict="PASS",
            state_digest=states(trial.seed, trial.axes),
        )
        tally.take(row)
    return list(tally.result("environment", 10, {}, []).notes)


def test_an_axis_without_an_effect_is_told_beside_one_that_has_it() -> None:
    assert notes_of(lambda seed, axes: f"{seed} {axes['SPEED']}") == [
        "axis UNREAD changed nothing: 6 pairs of trials that differ in it alone went through the same states"
    ]


def test_axes_that_change_something_are_not_told() -> None:
    assert notes_of(lambda seed, axes: f"{seed} {axes['SPEED']} {axes['UNREAD']}") == []


def test_an_effect_in_a_single_pair_is_one() -> None:
    assert (
        notes_of(lambda seed, axes: f"{seed} {axes['SPEED']} {(seed, axes['SPEED'], axes['UNREAD']) == (11, '2', 'b')}")
        == []
    )


def test_nothing_is_said_where_nothing_is_known() -> None:
    assert notes_of(lambda _seed, _axes: None) == []
    points = {
        **GRID,
        "design": "random",
        "points": 4,
        "axes": {
            "mass": {"kind": "robot_mass", "range": [0.8, 1.2]},
            "gain": {"kind": "motor_gain", "range": [0.8, 1.2]},
        },
    }
    assert notes_of(lambda seed, axes: f"{seed} {axes['mass']}", points) == []


def test_all_trials_alike_are_told_once() -> None:
    assert notes_of(lambda _seed, _axes: "one") == [
        "all 12 trials went through the same states: they count as one trial"
    ]
