"""Worlds and jobs that a person means by an id, the beginning of one, or a name."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

import pytest

from prefect_robomaker.schemas.operations.simulation_jobs import SimulationJobRequest
from prefect_robomaker.schemas.reports.names import name_label
from prefect_robomaker.schemas.reports.run_record import JobRecord, RunRecord
from prefect_robomaker.schemas.wire.arns import Kind
from prefect_robomaker.schemas.wire.errors import (
    ConfigurationError,
    InvalidParameterException,
    ResourceNotFoundException,
)
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.inspection.run_records import write_record
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service import references
from prefect_robomaker.tasks.service.references import (
    find_by_id,
    find_job,
    find_only_world,
    find_world,
    name_of_world,
)
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.stored_jobs import store_job

MOMENT = datetime(2026, 3, 2, tzinfo=UTC)


@pytest.fixture
def keep(service: Service) -> Callable[..., Resource]:
    """Stores a world without files, as generation jobs do: with its name, unless it is of an early release."""

    def stored(
        world_id: str, content: str, *, name: str | None = "flat", template: str | None = None, own: bool = False
    ) -> Resource:
        document: dict[str, Any] = {"bundle": {"bucket": "b", "prefix": f"worlds/{content}"}, "template": template}
        number = "" if own else f" {world_id.rpartition('-')[2]}"
        label = name_label(f"{name}{number}") if name else {}
        return service.catalog.create(
            Resource.new(
                arn=service.arn("world", world_id),
                kind="world",
                id=world_id,
                status="Active",
                labels={**label, **({"templateId": [template.rpartition("/")[2]]} if template else {})},
                document={**document, **({"name" if own else "templateName": name} if name else {})},
            ),
            token=None,
        )

    return stored


def test_a_world_is_found_by_arn_id_beginning_and_name(service: Service, keep: Callable[..., Resource]) -> None:
    first, second = keep("generation-82856b0yq33y/world-1", "a"), keep("generation-82856b0yq33y/world-2", "b")
    other = keep("generation-8285zzzzzzzz/world-3", "c")
    for wanted in (first.arn, first.id, "generation-82856/world-1", "82856b/world-1", "flat 1"):
        assert find_world(wanted, service).arn == first.arn, wanted
    assert find_world("8285/world-2", service).arn == second.arn
    assert find_world("generation-8285z", service).arn == other.arn


def test_a_given_name_goes_before_the_beginning_of_an_id(service: Service, keep: Callable[..., Resource]) -> None:
    """Ids are random: one may begin as a name does that somebody gave another world."""
    by_id, named = keep("import-flat56b0yq33", "a", name=None), keep("import-xxxx56b0yq33", "b", name="flat", own=True)
    assert name_of_world(named, service) == "flat"
    assert find_world("flat", service).arn == named.arn
    assert find_world("flat56", service).arn == by_id.arn
    assert find_world("import-flat", service).arn == by_id.arn


def test_what_deletes_a_world_takes_a_name_of_one_world_only(service: Service, keep: Callable[..., Resource]) -> None:
    older, newer = keep("generation-82856b0yq33y/world-1", "a"), keep("generation-9285zzzzzzzz/world-1", "a")
    assert find_world("flat 1", service).arn == newer.arn
    with pytest.raises(ConfigurationError, match=r"'flat 1' may be any of 2 worlds: generation-9285.*generation-8285"):
        find_only_world("flat 1", service)
    for wanted in (older.arn, older.id, "8285/world-1"):
        assert find_only_world(wanted, service).arn == older.arn, wanted
    service.catalog.delete(newer.arn)
    assert find_only_world("flat 1", service).arn == older.arn


def test_a_world_that_is_not_there_is_told_with_what_is_near(service: Service, keep: Callable[..., Resource]) -> None:
    keep("generation-82856b0yq33y/world-1", "a")
    with pytest.raises(ConfigurationError, match=r"'flat 2' is neither ARN, id nor name .*; did you mean 'flat 1'"):
        find_world("flat 2", service)
    for wanted in ("", "8", "generation-", "%", "generation-82_56b"):
        with pytest.raises(ConfigurationError, match="is neither ARN, id nor name"):
            find_world(wanted, service)
    with pytest.raises(ResourceNotFoundException, match="there is no resource arn:"):
        find_world(service.arn("world", "generation-1/world-1"), service)
    with pytest.raises(InvalidParameterException, match="it has to name a world"):
        find_world(service.arn("simulation-job", "sim-1"), service)


def test_a_misspelt_name_is_told_also_behind_hundreds_of_generated_worlds(
    service: Service, keep: Callable[..., Resource], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(references, "_LOOKED_AT", 3)
    keep("import-82856b0yq33y", "a", name="Küche", own=True)
    for number in range(4):
        keep(f"generation-82856b0yq33y/world-{number}", f"{number}")

    for look in (find_world, find_only_world):
        with pytest.raises(ConfigurationError, match=r"'Kuche' is neither .*; did you mean 'Küche'\?"):
            look("Kuche", service)


def test_a_misspelt_id_of_a_job_is_told_with_what_is_near(service: Service) -> None:
    own = "generation-82856b0yq33y"
    service.catalog.create(
        Resource.new(
            arn=service.arn("world-generation-job", own), kind="world-generation-job", id=own, status="Failed"
        ),
        token=None,
    )
    with pytest.raises(ConfigurationError, match=f"; did you mean '{own}'"):
        find_by_id("generation-82856b0yq33x", ("world-generation-job",), service)


def test_a_world_given_for_its_generation_job_is_told_with_its_job(
    service: Service, keep: Callable[..., Resource]
) -> None:
    keep("generation-82856b0yq33y/world-1", "c1")
    with pytest.raises(ConfigurationError, match=r"'flat 1' is neither .*; it is a world of generation-82856b0yq33y"):
        find_by_id("flat 1", ("world-generation-job",), service)


def test_a_name_of_several_worlds_is_refused_unless_they_are_the_same(
    service: Service, keep: Callable[..., Resource]
) -> None:
    keep("generation-aaaaaaaaaaaa/world-1", "same")
    again = keep("generation-bbbbbbbbbbbb/world-1", "same")
    assert find_world("flat 1", service).arn == again.arn, "the newest of those that are equal to the letter"
    keep("generation-cccccccccccc/world-1", "other")
    with pytest.raises(ConfigurationError) as caught:
        find_world("flat 1", service)
    assert "'flat 1' may be any of 2 worlds: generation-cccccccccccc/world-1 (flat 1, made 2" in str(caught.value)
    assert "generation-bbbbbbbbbbbb/world-1 (flat 1" in str(caught.value)


def test_a_template_that_was_made_again_with_another_body_has_worlds_of_the_same_name_that_are_told_apart(
    service: Service, keep: Callable[..., Resource], template: str
) -> None:
    keep("generation-aaaaaaaaaaaa/world-1", "old", name="two rooms", template=template)
    keep(
        "generation-bbbbbbbbbbbb/world-1", "new", name="two rooms", template=template.replace("template-", "template-x")
    )
    with pytest.raises(ConfigurationError, match="'two rooms 1' may be any of 2 worlds"):
        find_world("two rooms 1", service)


def test_a_world_of_an_early_release_is_called_as_its_template_is_and_is_not_overlooked(
    service: Service, keep: Callable[..., Resource], template: str
) -> None:
    early = keep("generation-aaaaaaaaaaaa/world-1", "old", name=None, template=template)
    assert find_world("two rooms 1", service).arn == early.arn
    keep("generation-bbbbbbbbbbbb/world-1", "new", name="two rooms", template=template)
    with pytest.raises(ConfigurationError, match="may be any of 2 worlds"):
        find_world("two rooms 1", service)
    call("UpdateWorldTemplate", {"template": template, "name": "loft"}, service)
    assert name_of_world(early, service) == "loft 1"
    assert find_world("two rooms 1", service).id == "generation-bbbbbbbbbbbb/world-1", (
        "it keeps the name it was made with"
    )


@pytest.fixture
def nights(service: Service, order: Callable[..., dict[str, Any]], keep: Callable[..., Resource]) -> list[list[str]]:
    """The ids of the jobs of two nights, each of the same two jobs, and the records of both."""
    world = keep("generation-82856b0yq33y/world-1", "a")
    found: list[list[str]] = []
    for night in ("night-20260301T0000", "night-20260302T0000"):
        requests = [order({"SPEED": speed}) for speed in ("1", "2")]
        for request in requests:
            request["simulationApplications"][0]["worldConfigs"] = [{"world": world.arn}]
        jobs = [store_job(SimulationJobRequest.model_validate(each), service, token=None) for each in requests]
        folder = service.settings.home / "runs" / night
        folder.mkdir(parents=True)
        records = [
            JobRecord(arn=job.arn, label=job.id, name=f"sleeper in flat 1, SPEED={speed}", status="Pending")
            for job, speed in zip(jobs, "12", strict=True)
        ]
        write_record(
            RunRecord(
                run_id=night, name="night", spec_path="n.yaml", state="succeeded", exit_code=0, started_at=MOMENT,
                ended_at=MOMENT, steps=[], jobs=records, run_dir=folder,
            )
        )  # fmt: skip
        found.append([job.id for job in jobs])
    return found


def test_a_job_is_found_by_arn_id_beginning_and_in_its_run_by_name(service: Service, nights: list[list[str]]) -> None:
    first, last = nights[0][0], nights[1][1]
    for wanted in (service.arn("simulation-job", first), first, first[:-1], first.removeprefix("sim-")[:-1]):
        assert find_job(wanted, service).id == first, wanted
    assert find_job("night-20260301T0000/sleeper in flat 1, SPEED=1", service).id == first
    assert find_job(f"night-20260301/{first[:-2]}", service).id == first
    assert find_job("latest/sleeper in flat 1, SPEED=2", service).id == last


def test_a_name_never_means_the_job_of_another_run_in_silence(service: Service, nights: list[list[str]]) -> None:
    application = name_of_first(service, nights)
    with pytest.raises(ConfigurationError) as caught:
        find_job(application, service)
    told = str(caught.value)
    assert f"{application!r} may be any of 4 simulation jobs" in told
    assert all(each in told for night in nights for each in night)
    # A name with parameters is unique in one run only, so the run has to be said.
    with pytest.raises(ConfigurationError, match=r"did you mean .*'latest/sleeper in flat 1, SPEED=2'"):
        find_job("sleeper in flat 1, SPEED=2", service)
    with pytest.raises(ConfigurationError, match="'night-' may be any of 2 runs"):
        find_job("night-/sleeper in flat 1, SPEED=2", service)
    with pytest.raises(ConfigurationError, match="is neither ARN, id nor name"):
        find_job(f"night-20260302T0000/{nights[0][0]}", service)


def test_jobs_to_perform_are_found_by_id(service: Service, nights: list[list[str]]) -> None:
    kinds: list[Kind] = ["simulation-job", "simulation-job-batch", "world-generation-job"]
    first = nights[0][0]
    for wanted in (first, first[:-1], service.arn("simulation-job", first)):
        assert find_by_id(wanted, kinds, service).id == first
    with pytest.raises(
        ConfigurationError, match=r"'batch-8285' is neither ARN nor id of a simulation job or .*, nor so"
    ):
        find_by_id("batch-8285", kinds, service, ", nor so")
    with pytest.raises(InvalidParameterException, match="it has to name a simulation-job or"):
        find_by_id(service.arn("world", "generation-1/world-1"), kinds, service)


def name_of_first(service: Service, nights: list[list[str]]) -> str:
    """The name that the catalog has of the jobs."""
    [label] = service.catalog.get(service.arn("simulation-job", nights[0][0])).labels["called"]
    return label


def test_another_world_of_the_name_is_not_hidden_by_many_newer_ones_that_are_the_same(
    service: Service, keep: Callable[..., Resource]
) -> None:
    """A generation each night, with the template changed weeks ago."""
    keep("generation-other0000000/world-1", "other")
    for night in range(20):
        keep(f"generation-same000000{night:02}/world-1", "same")
    with pytest.raises(ConfigurationError, match="'flat 1' may be any of 2 worlds"):
        find_world("flat 1", service)
