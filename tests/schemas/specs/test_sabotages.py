"""Sabotages: those of every challenge, own ones, and what becomes of a job's own trials."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.axes import subject_of
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.schemas.specs.sabotages import BUILT_IN, Sabotage, challenged_trials, parse_sabotages
from prefect_robomaker.schemas.wire.errors import ConfigurationError


def test_sabotages_of_every_challenge_are_valid_axes() -> None:
    for each in BUILT_IN:
        trials = Trials.model_validate(challenged_trials(None, 0, each))
        assert trials.trial(0, 0).axes == each.axes
    assert len({each.name for each in BUILT_IN}) == len(BUILT_IN)


def test_own_sabotages_are_names_with_values() -> None:
    found = parse_sabotages({"slippery": {"robot_friction": 0.2}, "slow and old": {"VERSION": "1"}}, "own.yaml")
    assert found == [
        Sabotage(name="slippery", axes={"robot_friction": 0.2}),
        Sabotage(name="slow and old", axes={"VERSION": "1"}),
    ]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ([], "own.yaml: sabotages are names with values of axes, such as slippery"),
        ({}, "own.yaml: sabotages are names"),
        ({"a": {"motor_gan": 1}}, "own.yaml: a: there is no axis 'motor_gan'; did you mean 'motor_gain'"),
        ({"a": {"floor.friction": 1}}, "there is no axis 'floor.friction'; did you mean 'robot_friction'"),
        ({"a": {"speed": 1}}, "no axis 'speed'; there are command_gain, .* and environment variables"),
        ({"a": {"motor_gain": 100}}, "a.motor_gain: 100 is not possible; motor_gain is a factor from 0.1 to 10"),
        ({"a": {"GAIN": 1}}, r"a.GAIN.values\[0\]: is 1; it has to be text"),
        ({"a": {"ROBOMAKER_SEED": "1"}}, "a: ROBOMAKER_SEED cannot differ from trial to trial"),
        ({"a": 3}, "own.yaml: a: is 3; values of 1 to 20 axes"),
        ({"a": {}}, "a: is {}; values of 1 to 20 axes"),
        ({"idle": {"motor_gain": 1}}, "idle: every challenge has a sabotage of this name"),
        ({"a\n": {"motor_gain": 1}}, "a sabotage's name has 1 to 60 letters"),
        ({f"a{number}": {"motor_gain": 1} for number in range(51)}, "has 51 sabotages; at most 50"),
    ],
)
def test_what_describes_no_sabotage_is_refused(data: Any, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said) as raised:
        parse_sabotages(data, "own.yaml")
    assert "\n" not in str(raised.value).replace("a\n", "")


OF_THE_JOB = Trials.model_validate(
    {
        "seeds": 3,
        "axes": {
            "gain": {"kind": "motor_gain", "values": [0.9, 1]},
            "delay": {"kind": "motor_delay_s", "values": [0.1, 0.3]},
            "SPEED": {"kind": "variable", "values": ["fast", "slow"]},
        },
    }
)


@given(st.sampled_from([None, *BUILT_IN, Sabotage(name="own", axes={"SPEED": "none", "robot_mass": 2.0})]))
def test_a_sabotaged_job_is_its_first_trial_with_other_values(sabotage: Sabotage | None) -> None:
    trials = Trials.model_validate(challenged_trials(OF_THE_JOB, 7, sabotage))
    assert (trials.count, trials.record_failed) == (1, 0)
    trial, plain = trials.trial(0, 7), OF_THE_JOB.trial(0, 7)
    assert trial.seed == plain.seed == 7
    wanted = dict(plain.axes)
    if sabotage is not None:
        given_way = {"gain": "motor_gain", "delay": "motor_delay_s"}
        changed = {subject_of(name) for name in sabotage.axes if name.islower()}
        wanted = {
            name: value for name, value in wanted.items() if subject_of(given_way.get(name, "variable")) not in changed
        }
        wanted |= sabotage.axes
    assert trial.axes == wanted
