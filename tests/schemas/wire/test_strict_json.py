"""Documents from outside are measured before they are read."""

import json

import pytest

from prefect_robomaker.schemas.wire import json_values
from prefect_robomaker.schemas.wire.errors import InvalidParameterException
from prefect_robomaker.schemas.wire.json_values import MAX_VALUES, load_strict

MANY = 10 * 1024 * 1024


@pytest.mark.parametrize(
    "document", [[1] * (MAX_VALUES + 1), {f"u{i}": 1 for i in range(MAX_VALUES + 1)}, [[]] * MAX_VALUES]
)
def test_a_document_of_too_many_values_is_not_even_read(document: object, monkeypatch: pytest.MonkeyPatch) -> None:
    text = json.dumps(document)
    monkeypatch.setattr(json_values.json, "loads", None)
    with pytest.raises(
        InvalidParameterException, match=rf"the body: some \d+ values; at most {MAX_VALUES} would be right"
    ):
        load_strict(text, "the body", MANY)


def test_a_document_of_as_many_values_as_are_allowed_is_read() -> None:
    assert len(load_strict(json.dumps([1] * MAX_VALUES), "the body", MANY)) == MAX_VALUES


def test_the_largest_batch_that_makes_sense_is_read() -> None:
    application = {"application": "arn", "launchConfig": {"environmentVariables": {f"E{i}": "v" for i in range(20)}}}
    job = {
        "tags": {f"t{i}": "v" for i in range(50)},
        "simulationApplications": [application],
        "vpcConfig": {"subnets": ["a"]},
    }
    batch = {"createSimulationJobRequests": [job] * 1000}
    assert load_strict(json.dumps(batch), "the body", MANY) == batch
