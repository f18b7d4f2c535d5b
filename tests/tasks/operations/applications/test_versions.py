"""Numbered versions: what an application was, whatever becomes of it."""

from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

import pytest
from helpers.application_calls import BUCKET, PACKAGE, Applications, at_once
from helpers.examples import examples
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from prefect_robomaker.schemas.wire.errors import (
    InvalidParameterException,
    LimitExceededException,
    ResourceNotFoundException,
)
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.simulations.planning.applications import MAX_VERSIONS
from prefect_robomaker.tasks.storage.object_store import ObjectInfo

DIGEST = "sha256:" + "0123456789abcdef" * 4


@pytest.fixture(params=["Robot", "Simulation"])
def applications(request: pytest.FixtureRequest, service: Service) -> Applications:
    return Applications.of(request.param, service)


def numbers(applications: Applications, name: str = "mine") -> list[str]:
    """The versions of an application, newest first."""
    named = [{"name": "name", "values": [name]}]
    return [
        version for _, version in applications.listed(versionQualifier="ALL", filters=named) if version != "$LATEST"
    ]


def test_a_version_is_what_the_application_was(applications: Applications) -> None:
    made = applications.create(sources=applications.stored("mine.tar"), tags={"team": "blue"})

    version = applications.version("mine", currentRevisionId=made["revisionId"])
    applications.update("mine", environment={"uri": "python://other"})

    untagged = {key: value for key, value in made.items() if key not in ("tags", "lastUpdatedAt")}
    assert {**version, "lastUpdatedAt": None} == {**untagged, "version": "1", "lastUpdatedAt": None}
    assert version["lastUpdatedAt"] >= made["lastUpdatedAt"]
    assert applications.describe(made["arn"], "1") == {**version, "tags": {"team": "blue"}}
    assert applications.describe("mine")["environment"] == {"uri": "python://other"}


def test_making_a_version_leaves_the_application_as_it_is(applications: Applications) -> None:
    made = applications.create()

    applications.version("mine")

    assert applications.describe("mine") == made


def test_a_version_goes_alone_and_its_number_never_comes_back(applications: Applications) -> None:
    applications.create()
    for number in ("1", "2"):
        assert applications.version("mine")["version"] == number

    applications.delete("mine", "2")
    applications.update("mine", **PACKAGE)

    assert applications.version("mine")["version"] == "3"
    assert numbers(applications) == ["3", "1"]
    with pytest.raises(ResourceNotFoundException, match=r"has no version '2'; it has \$LATEST, 1, 3"):
        applications.describe("mine", "2")
    for never in ("0", "01", "4"):
        with pytest.raises(ResourceNotFoundException):
            applications.describe("mine", never)


def test_forty_versions_are_kept_and_room_is_made_by_deleting(applications: Applications) -> None:
    applications.create()
    for _ in range(MAX_VERSIONS):
        applications.version("mine")

    with pytest.raises(LimitExceededException, match="at most 40"):
        applications.version("mine")
    applications.delete("mine", "7")

    assert applications.version("mine")["version"] == "41"
    assert len(numbers(applications)) == 40


def test_simultaneous_versions_have_numbers_of_their_own(applications: Applications) -> None:
    applications.create()

    answers = at_once([partial(applications.version, "mine")] * 6)

    assert sorted(answer["version"] for answer in answers) == ["1", "2", "3", "4", "5", "6"]


@pytest.mark.parametrize("application", ["nobody", "arn:aws:robomaker:us-east-1:000000000000:robot-application/x/1"])
def test_a_missing_application_is_a_wrong_parameter(applications: Applications, application: str) -> None:
    with pytest.raises(InvalidParameterException, match="there is no"):
        applications.version(application)


def test_a_version_is_no_application(applications: Applications) -> None:
    arn = applications.create()["arn"]
    applications.version("mine")

    with pytest.raises(ResourceNotFoundException):
        applications.describe(f"{arn}/version/1")
    applications.delete(f"{arn}/version/1")
    assert numbers(applications) == ["1"]


# What the caller expects


def test_a_version_of_an_old_revision_is_refused_with_the_current_one(applications: Applications) -> None:
    old = applications.create()["revisionId"]
    current = applications.update("mine", **PACKAGE)["revisionId"]

    with pytest.raises(InvalidParameterException, match=f"currentRevisionId.*{current}"):
        applications.version("mine", currentRevisionId=old)
    assert numbers(applications) == []
    assert applications.version("mine", currentRevisionId=current)["revisionId"] == current


def test_a_version_holds_the_archives_as_they_are_when_it_is_made(applications: Applications) -> None:
    made = applications.create(sources=applications.stored("mine.tar", b"one"))
    applications.stored("mine.tar", b"two")

    version = applications.version("mine")

    assert version["sources"][0]["etag"] == applications.service.store.head(BUCKET, "mine.tar").etag
    assert version["sources"][0]["etag"] != made["sources"][0]["etag"]
    applications.service.store.delete(BUCKET, "mine.tar")
    with pytest.raises(InvalidParameterException, match=r"sources\[0\]: s3://applications/mine.tar cannot be read"):
        applications.version("mine")


def test_etags_that_are_expected_have_to_be_there(applications: Applications) -> None:
    sources = [*applications.stored("one.tar", b"one"), *applications.stored("two.tar", b"two")]
    etags = [source["etag"] for source in applications.create(sources=sources)["sources"]]

    # SDKs hand out ETags in quotes.
    assert applications.version("mine", s3Etags=[f'"{etags[1]}"', etags[0]])["version"] == "1"
    assert applications.version("mine", s3Etags=[])["version"] == "2"
    for wrong in ([etags[0]], [etags[0], etags[0]], ["x", "y"]):
        with pytest.raises(InvalidParameterException, match=f"s3Etags.*{etags[0]}"):
            applications.version("mine", s3Etags=wrong)
    applications.create("package")
    with pytest.raises(InvalidParameterException, match=r"s3Etags.*it has no archives"):
        applications.version("package", s3Etags=etags)
    assert numbers(applications) == ["2", "1"]


def test_a_digest_is_what_the_images_name_says_or_else_the_caller(applications: Applications) -> None:
    applications.create("fixed", environment={"uri": f"registry.example.com/app@{DIGEST}"})
    applications.create("tagged", environment={"uri": "registry.example.com/app:1.0"})
    applications.create("package")

    applications.version("fixed", imageDigest=DIGEST.upper())
    applications.version("tagged", imageDigest=DIGEST)

    assert applications.describe("fixed", "1")["imageDigest"] == DIGEST
    assert applications.describe("tagged", "1")["imageDigest"] == DIGEST
    assert "imageDigest" not in applications.describe("tagged")
    with pytest.raises(InvalidParameterException, match=f"imageDigest.*{DIGEST}"):
        applications.version("fixed", imageDigest=DIGEST.replace("0", "1"))
    with pytest.raises(InvalidParameterException, match=r"imageDigest.*is no container image"):
        applications.version("package", imageDigest=DIGEST)
    with pytest.raises(InvalidParameterException, match="imageDigest"):
        applications.version("tagged", imageDigest="latest")


class Meddling:
    """An object store that lets somebody do something each time it is asked what an object is."""

    def __init__(self, store: Any, deeds: list[Any]) -> None:
        self._store, self._deeds = store, deeds

    def head(self, bucket: str, key: str) -> ObjectInfo:
        found = self._store.head(bucket, key)
        if self._deeds:
            self._deeds.pop()()
        return found

    def __getattr__(self, name: str) -> Any:
        return getattr(self._store, name)


def test_a_version_is_of_one_revision_though_the_application_changes_while_it_is_made(
    applications: Applications,
) -> None:
    old = applications.create(sources=applications.stored("mine.tar"))
    change = partial(applications.update, "mine", environment={"uri": "python://other"})
    slow = replace(applications.service, store=Meddling(applications.service.store, [change]))  # type: ignore[arg-type]

    version = Applications.of(applications.role, slow).version("mine")

    assert version["environment"] == {"uri": "python://other"}
    assert "sources" not in version
    assert version["revisionId"] == applications.describe("mine")["revisionId"] != old["revisionId"]
    assert numbers(applications) == ["1"]


# Any sequence of calls

_names = count()
_steps = st.lists(
    st.one_of(
        st.sampled_from(["update", "version", "delete", "create"]),
        st.tuples(st.just("delete version"), st.integers(1, 5)),
    ),
    max_size=12,
)


@examples(40, suppress_health_check=(HealthCheck.function_scoped_fixture,))
@given(steps=_steps)
def test_after_any_calls_the_versions_are_those_that_were_made_and_not_deleted(service: Service, steps: Any) -> None:
    robots, name = Applications.of("Robot", service), f"robot-{next(_names)}"
    revision = robots.create(name)["revisionId"]
    model: dict[int, str] = {}
    last, exists = 0, True
    for step in steps:
        if step == "create" and not exists:
            revision, model, last, exists = robots.create(name)["revisionId"], {}, 0, True
        elif step == "delete":
            robots.delete(name)
            model, exists = {}, False
        elif isinstance(step, tuple):
            robots.delete(name, str(step[1]))
            model.pop(step[1], None)
        elif step == "update" and exists:
            revision = robots.update(name, **PACKAGE)["revisionId"]
        elif step == "version" and exists:
            last += 1
            assert robots.version(name)["version"] == str(last)
            model[last] = revision

    assert numbers(robots, name) == [str(number) for number in reversed(model)]
    assert {number: robots.describe(name, str(number))["revisionId"] for number in model} == model
