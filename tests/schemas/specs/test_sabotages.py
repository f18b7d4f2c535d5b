"""Sabotages: those of every challenge, own ones, and what becomes of a job's own trials."""

import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.axes import subject_of
from prefect_robomaker.schemas.runs.trials import Trials
from prefect_robomaker.schemas.specs.check import load_spec
from prefect_robomaker.schemas.specs.sabotages import (
    BUILT_IN,
    Sabotage,
    challenged_trials,
    parse_sabotages,
    read_sabotages,
)
from prefect_robomaker.schemas.specs.yaml_nodes import parse
from prefect_robomaker.schemas.wire.errors import SpecError


def test_sabotages_of_every_challenge_are_valid_axes() -> None:
    for each in BUILT_IN:
        trials = Trials.model_validate(challenged_trials(None, 0, each))
        assert trials.trial(0, 0).axes == each.axes
    assert len({each.name for each in BUILT_IN}) == len(BUILT_IN)


def test_own_sabotages_are_names_with_values() -> None:
    own = parse("{slippery: {robot_friction: 0.2}, heavy: {robot_mass: '2'}, slow and old: {VERSION: '1'}}", "own.yaml")
    assert parse_sabotages(own) == [
        Sabotage(name="slippery", axes={"robot_friction": 0.2}),
        Sabotage(name="heavy", axes={"robot_mass": 2.0}),
        Sabotage(name="slow and old", axes={"VERSION": "1"}),
    ]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ([], "sabotages are names with values of axes, such as slippery"),
        ({}, "sabotages are names"),
        ({"a": {"motor_gan": 1}}, "a.motor_gan: there is no axis 'motor_gan'; did you mean 'motor_gain'"),
        ({"a": {"floor.friction": 1}}, "there is no axis 'floor.friction'; did you mean 'robot_friction'"),
        ({"a": {"speed": 1}}, "no axis 'speed'; there are command_gain, .* and environment variables"),
        ({"a": {"motor_gain": 100}}, "a.motor_gain: 100 is not possible; motor_gain is a factor from 0.1 to 10"),
        ({"a": {"motor_gain": True}}, "a.motor_gain: is true; motor_gain is a factor from 0.1 to 10"),
        ({"a": {"motor_gain": None}}, "a.motor_gain: is null; motor_gain is a factor from 0.1 to 10"),
        ({"a": {"motor_gain": [1]}}, r"a.motor_gain: is \[1\]; motor_gain is a factor from 0.1 to 10"),
        ({"a": {"motor_gain": {}}}, "a.motor_gain: is {}; motor_gain is a factor from 0.1 to 10"),
        ({"a": {"GAIN": 1}}, "a.GAIN: is 1; it has to be text"),
        ({"a": {"GAIN": "${{ parameters.gain }}"}}, "a.GAIN: is '.*gain }}'; sabotages have no references, so write"),
        ({"a": {"GAIN": "v${{ index }}"}}, "a.GAIN: is .*; sabotages have no references"),
        ({"a": {"motor_gain": "${{ parameters.gain }}"}}, "a.motor_gain: is .*; sabotages have no references"),
        ({"a": {"ROBOMAKER_SEED": "1"}}, "a.ROBOMAKER_SEED: ROBOMAKER_SEED cannot differ from trial to trial"),
        (
            {"a": {"lidar_noise_factor": 2, "lidar_noise_std_m": 0.1}},
            "a: lidar_noise_.* both change the noise of the lidar; leave one out",
        ),
        ({"a": 3}, "a: is 3; values of 1 to 20 axes"),
        ({"a": {}}, "a: is {}; values of 1 to 20 axes"),
        ({"idle": {"motor_gain": 1}}, "idle: every challenge has a sabotage of this name"),
        ({"a\n": {"motor_gain": 1}}, "a sabotage's name has 1 to 60 letters"),
        ({f"a{number}": {"motor_gain": 1} for number in range(51)}, "has 51 sabotages; at most 50"),
    ],
)
def test_what_describes_no_sabotage_is_refused(data: Any, said: str) -> None:
    found, [problem] = read_sabotages(data)
    assert found == []
    assert re.search(said, str(problem))
    assert "\n" not in str(problem).replace("a\n", "")


MISTAKEN = """\
right: {robot_friction: 0.5}
slippery: {robot_friction: true}
two at once:
  motor_gan: 1
  GAIN: "${{ parameters.gain }}"
idle: {motor_gain: 1}
"""
MISTAKES = (
    (2, 28, "slippery.robot_friction: is true; robot_friction is a factor from 0.01 to 10"),
    (4, 3, "two at once.motor_gan: there is no axis 'motor_gan'; did you mean 'motor_gain'?"),
    (5, 9, "two at once.GAIN: is '${{ parameters.gain }}'; sabotages have no references, so write the value itself"),
    (6, 1, "idle: every challenge has a sabotage of this name; choose another one"),
)


def test_all_mistakes_are_told_at_once_each_at_its_place() -> None:
    with pytest.raises(SpecError) as raised:
        parse_sabotages(parse(MISTAKEN, "own.yaml"))
    assert str(raised.value).splitlines() == [f"own.yaml:{line}:{column}: {said}" for line, column, said in MISTAKES]

    inside = "".join(f"  {line}\n" for line in MISTAKEN.splitlines())
    with pytest.raises(SpecError) as raised:
        load_spec(
            f"version: 1\nname: a\nsabotages:\n{inside}  odd: 3\nsteps: {{l: {{operation: ListWorlds}}}}", "s.yaml"
        )
    assert str(raised.value).splitlines() == [
        *(f"s.yaml:{line + 3}:{column + 2}: sabotages.{said}" for line, column, said in MISTAKES),
        "s.yaml:10:8: sabotages.odd: is 3; it has to be a mapping",
    ]


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
