"""Tags of every kind of resource, at any time of its life."""

from typing import get_args

import pytest
from helpers.application_calls import Applications
from helpers.examples import examples
from helpers.fleet_calls import Fleets
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.arns import Kind
from prefect_robomaker.schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from prefect_robomaker.tasks.catalog import Resource
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service

PREFIX = "arn:aws:robomaker:us-east-1:000000000000"
OPERATIONS = {"ListTagsForResource": {}, "TagResource": {"tags": {"a": "b"}}, "UntagResource": {"tagKeys": ["a"]}}
CHARACTERS = "abzAZ09 _.-/+=:"
KEYS = st.text(CHARACTERS, min_size=1, max_size=128).filter(lambda key: not key.lower().startswith("aws:"))


def tags_of(arn: str, service: Service) -> dict[str, str]:
    return call("ListTagsForResource", {"resourceArn": arn}, service)["tags"]


def tag(arn: str, tags: dict[str, str], service: Service) -> None:
    assert call("TagResource", {"resourceArn": arn, "tags": tags}, service) == {}


def untag(arn: str, keys: list[str], service: Service) -> None:
    assert call("UntagResource", {"resourceArn": arn, "tagKeys": keys}, service) == {}


@pytest.fixture
def fleet(service: Service) -> str:
    """ARN of a fleet with two tags."""
    return Fleets(service).fleet(tags={"site": "north", "Site": ""})


@pytest.mark.parametrize("kind", get_args(Kind))
def test_every_kind_of_resource_has_tags(service: Service, kind: str) -> None:
    arn = service.arn(kind, "generation-000000000000/world-1")
    new = Resource.new(arn=arn, kind=kind, id="x", status="Pending", tags={"kept": "1"})
    service.catalog.create(new, token=None)

    tag(arn, {"more": "2"}, service)
    untag(arn, ["kept"], service)

    assert tags_of(arn, service) == {"more": "2"}


def test_values_are_overwritten_and_keys_differ_in_case(service: Service, fleet: str) -> None:
    tag(fleet, {"site": "south", "owner": "a/b:c+d=e f.g-h_i"}, service)

    expected = {"site": "south", "Site": "", "owner": "a/b:c+d=e f.g-h_i"}
    assert tags_of(fleet, service) == expected
    assert call("DescribeFleet", {"fleet": fleet}, service)["tags"] == expected


def test_keys_that_are_not_there_are_ignored(service: Service, fleet: str) -> None:
    untag(fleet, ["none", "site", "site", "aws:x"], service)
    untag(fleet, [], service)

    assert tags_of(fleet, service) == {"Site": ""}


def test_fifty_tags_are_counted_after_merging(service: Service, fleet: str) -> None:
    tag(fleet, {f"key-{number}": "" for number in range(48)}, service)

    with pytest.raises(InvalidParameterException, match="would have 51 tags; a resource has at most 50"):
        tag(fleet, {"key-0": "changed", "one too many": ""}, service)
    assert len(tags_of(fleet, service)) == 50
    assert tags_of(fleet, service)["key-0"] == ""
    tag(fleet, {f"key-{number}": "changed" for number in range(48)}, service)
    untag(fleet, ["site"], service)
    tag(fleet, {"room": "again"}, service)
    assert len(tags_of(fleet, service)) == 50


@pytest.mark.parametrize(
    ("tags", "says"),
    [
        ({"aws:cloudformation:stack": "x"}, "'aws:' are reserved"),
        ({"AWS:x": "x"}, "reserved"),
        ({"": "x"}, "tags"),
        ({"x" * 129: "x"}, "tags"),
        ({"x": "x" * 257}, r"tags\.x"),
        ({"x": "mail@home"}, r"tags\.x"),
        ({"mail@home": "x"}, "tags"),
        ({"x": None}, r"tags\.x"),
        ({f"key-{number}": "" for number in range(51)}, "50"),
        (None, "tags"),
    ],
)
def test_tags_that_make_no_sense_are_refused_and_none_is_set(
    service: Service, fleet: str, tags: dict[str, str] | None, says: str
) -> None:
    with pytest.raises(InvalidParameterException, match=says):
        call("TagResource", {"resourceArn": fleet, "tags": tags}, service)
    assert tags_of(fleet, service) == {"site": "north", "Site": ""}


@pytest.mark.parametrize("operation", OPERATIONS)
def test_what_is_not_there_is_not_found_and_what_is_no_arn_is_refused(service: Service, operation: str) -> None:
    for arn in (f"{PREFIX}:robot/none/1", f"{PREFIX}:world/generation-000000000000/world-1"):
        with pytest.raises(ResourceNotFoundException, match="there is no resource"):
            call(operation, {"resourceArn": arn, **OPERATIONS[operation]}, service)
    for arn in ("arn:anything", f"{PREFIX}:simulation-applicationmine", f"{PREFIX}:lamp/1"):
        with pytest.raises(InvalidParameterException, match=r"has to look like|is not known"):
            call(operation, {"resourceArn": arn, **OPERATIONS[operation]}, service)


@pytest.mark.parametrize("operation", OPERATIONS)
def test_versions_have_no_arn_of_their_own(service: Service, operation: str) -> None:
    applications = Applications.of("Robot", service)
    arn = applications.create()["arn"]
    applications.version(arn)

    with pytest.raises(ResourceNotFoundException):
        call(operation, {"resourceArn": f"{arn}/version/1", **OPERATIONS[operation]}, service)


def test_all_versions_of_an_application_have_its_tags(service: Service) -> None:
    applications = Applications.of("Robot", service)
    arn = applications.create(tags={"team": "blue"})["arn"]
    applications.version(arn)

    tag(arn, {"team": "red", "year": "2"}, service)

    for version in ("1", "$LATEST"):
        assert applications.describe(arn, version)["tags"] == {"team": "red", "year": "2"}


def test_a_job_that_has_ended_takes_tags(service: Service) -> None:
    fleets = Fleets(service)
    yard = fleets.fleet()
    fleets.robot("rover", yard)
    job = fleets.deploy(yard, fleets.application(), tags={"a": "1"})["arn"]
    fleets.cancel(job)

    tag(job, {"b": "2"}, service)
    untag(job, ["a"], service)

    assert fleets.described(job)["tags"] == tags_of(job, service) == {"b": "2"}
    assert fleets.described(job)["status"] == "Canceled"


def test_tags_go_with_their_resource(service: Service, fleet: str) -> None:
    call("DeleteFleet", {"fleet": fleet}, service)

    with pytest.raises(ResourceNotFoundException):
        tags_of(fleet, service)


@examples(25, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(
    steps=st.lists(
        st.dictionaries(KEYS, st.text(CHARACTERS, max_size=256), max_size=5) | st.lists(KEYS, max_size=3), max_size=5
    )
)
def test_any_sequence_of_tags_gives_what_a_dictionary_gives(
    service: Service, steps: list[dict[str, str] | list[str]]
) -> None:
    fleet = Fleets(service).fleet()
    expected: dict[str, str] = {}
    for step in steps:
        if isinstance(step, dict):
            tag(fleet, step, service)
            expected |= step
        else:
            gone = [*step, *list(expected)[:1]]
            untag(fleet, gone, service)
            expected = {key: value for key, value in expected.items() if key not in gone}

    assert tags_of(fleet, service) == expected
