"""Steps with more requests than one batch may have."""

from dataclasses import replace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.runs.trials import TrialCounts
from prefect_robomaker.schemas.specs.batch_splitting import MOST_REQUESTS, EarlierParts, Part, parts_of, step_of

BATCH = "StartSimulationJobBatch"


@given(st.integers(min_value=0, max_value=3 * MOST_REQUESTS + 1))
def test_every_request_is_in_one_part_in_order_and_no_part_is_too_large(count: int) -> None:
    request = {"createSimulationJobRequests": [{"tags": {"n": str(n)}} for n in range(count)], "tags": {"a": "b"}}

    parts = parts_of(BATCH, request)

    assert [each for part in parts for each in part.request["createSimulationJobRequests"]] == request[
        "createSimulationJobRequests"
    ]
    assert all(len(part.request["createSimulationJobRequests"]) <= MOST_REQUESTS for part in parts)
    assert all(part.request["tags"] == {"a": "b"} for part in parts)
    assert [part.number for part in parts] == list(range(1, len(parts) + 1))
    assert {part.of for part in parts} == {len(parts)}


def test_a_step_that_fits_is_one_part_under_its_own_name() -> None:
    assert [part.name("drive") for part in parts_of(BATCH, {"createSimulationJobRequests": [{}]})] == ["drive"]
    assert parts_of("CreateWorldTemplate", {"name": "flat"}) == [Part({"name": "flat"})]


def test_the_batches_of_a_campaign_have_names_and_tokens_of_their_own() -> None:
    request = {"createSimulationJobRequests": [{}] * (2 * MOST_REQUESTS + 1), "clientRequestToken": "night-7"}

    parts = parts_of(BATCH, request)

    assert [part.name("drive") for part in parts] == ["drive_1_of_3", "drive_2_of_3", "drive_3_of_3"]
    assert {step_of(part.name("drive")) for part in parts} == {step_of("drive")} == {"drive"}
    tokens = [part.request["clientRequestToken"] for part in parts]
    assert tokens[0] == "night-7"
    assert len(set(tokens)) == 3
    assert all(len(token) <= 64 for token in tokens)
    assert tokens == [part.request["clientRequestToken"] for part in parts_of(BATCH, request)]


def test_a_campaign_knows_how_many_trials_it_orders() -> None:
    requests: list[dict[str, Any]] = [{"trials": {"seeds": 10}}] * MOST_REQUESTS + [{"trials": {"seeds": 5}}, {}]

    assert {part.trials for part in parts_of(BATCH, {"createSimulationJobRequests": requests})} == {10_005}


def test_the_trials_of_a_campaigns_batches_are_added_up() -> None:
    earlier = EarlierParts().followed_by({}, {}, TrialCounts(9_990, 10_000)).followed_by({}, {})

    assert earlier.with_trials(TrialCounts(17, 5_000), 15_000) == TrialCounts(10_007, 15_000)
    assert earlier.with_trials(None, 15_000) == TrialCounts(9_990, 15_000)
    recording = TrialCounts(17, 5_000, 1, 2, "records trial 3 of job sim-1")
    assert earlier.with_trials(recording, 15_000) == replace(recording, finished=10_007, total=15_000)
    assert EarlierParts().with_trials(TrialCounts(17, 5_000), 0) == TrialCounts(17, 5_000)
    assert EarlierParts().with_trials(None, 0) is None


def test_problems_are_told_where_they_are_in_the_whole_step() -> None:
    part = Part({}, number=3, of=3)

    assert part.location(("createSimulationJobRequests", 5, "iamRole")) == (
        "createSimulationJobRequests",
        2 * MOST_REQUESTS + 5,
        "iamRole",
    )
    assert part.location(("batchPolicy",)) == ("batchPolicy",)


def test_what_references_see_has_the_jobs_of_all_batches_and_progress_counts_them() -> None:
    first = {"arn": "batch/1", "status": "Completed", "createdRequests": [{"arn": "sim/1"}], "failedRequests": []}
    second = {"arn": "batch/2", "status": "Completed", "createdRequests": [{"arn": "sim/2"}], "failedRequests": [{}]}

    earlier = EarlierParts().followed_by(first, {"completed": 1}).followed_by(second, {"completed": 1, "failed": 1})

    assert earlier.output["createdRequests"] == [{"arn": "sim/1"}, {"arn": "sim/2"}]
    assert earlier.output["failedRequests"] == [{}]
    assert earlier.output["arn"] == "batch/2"
    assert earlier.with_counts({"running": 2}) == {"completed": 2, "failed": 1, "running": 2}
