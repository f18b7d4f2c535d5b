"""What sets jobs apart."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.variants import variants
from prefect_robomaker.schemas.runs.axes import AXIS_TAG


def request(application: str = "scout", seed: int | None = None, **variables: str) -> dict[str, Any]:
    launch = {"environmentVariables": variables}
    made: dict[str, Any] = {"robotApplications": [{"application": application, "launchConfig": launch}]}
    return made if seed is None else made | {"seed": seed}


def test_jobs_are_told_apart_by_what_differs() -> None:
    assert variants([request(SPEED="1", MODE="x"), request(SPEED="2", MODE="x"), request(MODE="x")]) == [
        "SPEED=1",
        "SPEED=2",
        "",
    ]
    arn = "arn:aws:robomaker:us-east-1:000000000000:robot-application/my-nav/1577836800000"
    assert variants([request(seed=1), request(arn, seed=2)]) == ["robot=scout, seed=1", "robot=my-nav, seed=2"]


def test_what_jobs_of_axes_and_others_have_in_common_is_not_told() -> None:
    cell = {"tags": {f"{AXIS_TAG}robot": "scout", f"{AXIS_TAG}SPEED": "1"}}
    made = [
        {"step": "axes", "maxJobDurationInSeconds": 300, **request(SPEED="1", seed=4), **cell},
        {"step": "every", "maxJobDurationInSeconds": 300, **request(SPEED="2", seed=4)},
    ]

    assert variants(made) == ["step=axes, SPEED=1", "step=every, SPEED=2"]


def test_values_of_secrets_are_not_told() -> None:
    assert variants([request(X_TOKEN="a", SPEED="1"), request(X_TOKEN="b", SPEED="2")]) == ["SPEED=1", "SPEED=2"]


def test_of_many_settings_those_are_named_that_set_a_job_apart() -> None:
    common = {"A": "1", "B": "1", "C": "1"}
    requests = [
        request("pusher", seed=1, **common, LIMIT="0.1"),
        request("pusher", seed=2, **common),
        request("pusher", seed=3, **common, LIMIT="0.1"),
        request("walker", seed=4, D="2"),
    ]

    told = variants(requests)

    assert len(set(told)) == len(requests)
    assert told[0].endswith("LIMIT=0.1, seed=1")
    assert told[3] == "robot=walker, seed=4, D=2"


def test_worlds_and_tokens_are_told_elsewhere() -> None:
    worlds = [[{"world": "a"}], [{"world": "b"}]]
    requests = [
        {"clientRequestToken": str(number), "simulationApplications": [{"application": "i", "worldConfigs": world}]}
        for number, world in enumerate(worlds)
    ]
    assert variants(requests) == ["", ""]


def test_axes_of_trials_vary_in_a_job_and_not_between_jobs() -> None:
    """They would fill its name: `agent, seeds=1, kind=variable`."""
    axes = {"SPEED": {"kind": "variable", "values": ["1", "2"]}}
    made = [{**request(), "trials": {"seeds": 3, "axes": axes}}, {**request(), "trials": {"seeds": 2}}, request()]
    assert variants(made) == ["trials=6", "trials=2", ""]
    alike = [{**request(GAIN=gain), "trials": {"seeds": 2, "axes": axes}} for gain in "12"]
    alike[0]["trials"] = {"seeds": 2, "axes": {"OTHER": axes["SPEED"]}}
    assert variants(alike) == ["GAIN=1", "GAIN=2"]
    as_text = [request(ROBOMAKER_TRIALS='{"seeds": 3}'), request(ROBOMAKER_TRIALS='{"seeds": 4}')]
    assert variants(as_text) == ["trials=3", "trials=4"]


def test_requirements_are_named_by_their_names_and_only_where_nothing_else_tells_jobs_apart() -> None:
    def asked(name: str, **more: Any) -> dict[str, Any]:
        return {**request(), "requirements": [{"name": name, "kind": "no_collision", **more}]}

    assert variants([asked("soft"), asked("hard")]) == ["requirements: soft", "requirements: hard"]
    assert variants([asked("soft") | {"seed": 1}, asked("hard") | {"seed": 2}]) == ["seed=1", "seed=2"]
    assert variants([asked("soft"), request()]) == ["requirements: soft", ""]
    limits = variants([asked("soft", limit=1), asked("soft", limit=2)])
    assert limits == ["limit=1", "limit=2"]


def test_a_policy_is_always_named() -> None:
    made = [
        {
            **request(A="1", B="1", C="1", LIMIT=str(number)),
            "policy": "a.onnx",
            "extra": [f"x{number}", f"y{number}", f"z{number}"],
        }
        for number in range(3)
    ]
    assert all("policy=a.onnx" in each for each in variants([*made, request()])[:3])


_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=40),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@given(st.lists(st.dictionaries(st.text(max_size=8), _values, max_size=3), max_size=5))
def test_any_requests_give_one_short_line_each(requests: list[dict[str, Any]]) -> None:
    said = variants(requests)

    assert len(said) == len(requests)
    assert variants(requests[:1] * 3) == [""] * (3 if requests else 0)
