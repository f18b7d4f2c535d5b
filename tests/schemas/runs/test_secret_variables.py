"""Plans without the secrets in them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.runs.variables import HIDDEN, secret_names, without_secrets


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
