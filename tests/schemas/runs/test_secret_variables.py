"""Plans and requests without the secrets in them."""

import json
from typing import Any

import pytest
from helpers.variable_axes import trials_of_variables, variables
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.runs.trials import TRIALS_VARIABLE, Trials
from prefect_robomaker.schemas.runs.variables import (
    HIDDEN,
    SECRETS_VARIABLE,
    hide_secrets,
    secret_names,
    without_secrets,
)


@pytest.mark.parametrize(
    "name",
    ["PASSWORD", "DB_PASSWORD", "GITHUB_TOKEN", "AWS_SECRET_ACCESS_KEY", "api_key", "MY_APIKEY", "SSH_PRIVATE_KEY_PEM"],
)
def test_names_that_say_so(name: str) -> None:
    assert secret_names({name: "a"}) == {name}


@pytest.mark.parametrize("name", ["PATH", "PWD", "KEYBOARD", "TOKENIZER", "SEED", "KEY_RATE", "ROBOMAKER_SECRETS"])
def test_names_that_do_not(name: str) -> None:
    assert secret_names({name: "a"}) == set()


def test_variables_that_are_marked() -> None:
    assert secret_names({"ROBOMAKER_SECRETS": "A, B,NOT_THERE", "A": "1", "B": "2", "C": "3"}) == {"A", "B"}


@given(st.dictionaries(st.text("ABC_TOKEN", min_size=1), st.text()))
def test_nothing_else_changes(variables: dict[str, str]) -> None:
    plan = RunPlan.model_construct(
        environment=variables, robot_application=None, simulation_application=None, programs=[]
    )

    hidden = secret_names(variables)
    after = without_secrets(plan).environment
    assert after.keys() == variables.keys()
    assert all(after[name] in (HIDDEN, "") for name in hidden)


def test_requests_without_their_secrets() -> None:
    names = "MARKED"

    def batch(marked: str, token: str) -> dict[str, Any]:
        robot = {"environmentVariables": {"MARKED": marked, SECRETS_VARIABLE: names, "X_TOKEN": token}}
        simulation = {"environmentVariables": {"MARKED": marked, "EMPTY_TOKEN": "", "SPEED": "2"}}
        return {
            "createSimulationJobRequests": [
                {"robotApplications": [{"application": "TOKEN", "launchConfig": robot}], "tags": {"X_TOKEN": "a"}},
                {"simulationApplications": [{"launchConfig": simulation}]},
            ]
        }

    assert hide_secrets(batch("hunter", "2")) == batch(HIDDEN, HIDDEN)
    open_request = {"robotApplications": [{"launchConfig": {"environmentVariables": {"SPEED": "2"}}}]}
    assert hide_secrets(open_request) is open_request


def test_axes_of_trials_are_hidden_like_variables() -> None:
    """As many values as before, which differ, so that what has them can be read again."""

    def request(mine: list[str], tokens: list[str]) -> dict[str, Any]:
        trials = {"seeds": 2, "axes": variables({"MINE": mine, "X_TOKEN": tokens, "SPEED": ["1", "2"]})}
        launched = {SECRETS_VARIABLE: "MINE", "X_TOKEN": tokens[0], TRIALS_VARIABLE: json.dumps(trials)}
        return {"robotApplications": [{"launchConfig": {"environmentVariables": launched}}], "trials": trials}

    hidden = hide_secrets(request(["hunter"], ["a", "b", "c"]))

    assert hidden == request([HIDDEN], [HIDDEN, "(secret 2)", "(secret 3)"])
    assert Trials.model_validate(hidden["trials"]).count == 12
    assert hide_secrets(hidden) == hidden


def test_the_launch_variable_of_trials_alone_and_texts_that_are_none() -> None:
    def launch(text: str) -> dict[str, Any]:
        return {"environmentVariables": {TRIALS_VARIABLE: text, "X_TOKEN": HIDDEN}}

    trials = '{"seeds": 1, "axes": {"X_PASSWORD": {"kind": "variable", "values": ["hunter2"]}}}'
    assert hide_secrets(launch(trials)) == launch(trials.replace("hunter2", HIDDEN))
    for text in ("", "{", "[]", "[" * 10_000, '{"axes": 3}', '{"axes": {"SPEED": 3}}'):
        assert hide_secrets(launch(text)) == launch(text)


def test_plans_have_no_secret_axes() -> None:
    trials = trials_of_variables(1, {"MINE": ["1", "2"], "X_TOKEN": ["3"], "SPEED": ["4"]}, exclude=[{"MINE": "2"}])
    marked = "MINE"
    plan = RunPlan.model_construct(
        environment={SECRETS_VARIABLE: marked},
        robot_application=None,
        simulation_application=None,
        programs=[],
        trials=trials,
    )

    shown = without_secrets(plan).trials

    assert shown is not None
    assert shown == trials_of_variables(
        1, {"MINE": [HIDDEN, "(secret 2)"], "X_TOKEN": [HIDDEN], "SPEED": ["4"]}, exclude=[{"MINE": "(secret 2)"}]
    )
