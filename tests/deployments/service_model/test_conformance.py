"""The service model we ship against the one that was published last: all operations, shapes and paginators."""

import copy
import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from helpers.published_model import Model, published_files

from prefect_robomaker.deployments.service_model.model import paginators_model, service_model
from tools.reference.differences import DIFFERENCES

Facts = dict[str, Any]

# What says nothing about the interface: prose, and the titles of the service.
PROSE = frozenset({"documentation", "deprecatedMessage"})
TITLES = frozenset({"serviceFullName", "jsonVersion"})


def facts(model: Model) -> Facts:
    """Everything a service model says, by place; places are those of `Difference.where`."""
    found = {f"metadata:{key}": value for key, value in model["metadata"].items() if key not in TITLES}
    for name, operation in model["operations"].items():
        found[name] = "operation"
        found |= {f"{name}:{trait}": _unordered(value) for trait, value in operation.items() if trait not in PROSE}
    for name, shape in model["shapes"].items():
        found |= dict(_shape_facts(name, shape))
    return found


def _shape_facts(name: str, shape: Model) -> Iterator[tuple[str, Any]]:
    yield name, shape["type"]
    for trait, value in shape.items():
        if trait not in PROSE | {"type", "members"}:
            yield f"{name}:{trait}", _unordered(value)
    for member, reference in shape.get("members", {}).items():
        yield f"{name}.{member}", reference["shape"]
        for trait, value in reference.items():
            if trait not in PROSE | {"shape"}:
                yield f"{name}.{member}:{trait}", value


def _unordered(value: Any) -> Any:
    return sorted(value, key=json.dumps) if isinstance(value, list) else value


def differences(ours: Model, theirs: Model) -> dict[str, tuple[Any, Any]]:
    """Places where two models say different things, with what they say; `None`: nothing."""
    left, right = facts(ours), facts(theirs)
    # A whole shape or operation that one of them does not have is one difference.
    alone = {each for each in left.keys() ^ right.keys() if "." not in each and ":" not in each}
    return {
        place: (left.get(place), right.get(place))
        for place in sorted(left.keys() | right.keys())
        if left.get(place) != right.get(place)
        and (place in alone or place.replace(":", ".").split(".")[0] not in alone)
    }


DOCUMENTED = {each.where: (each.ours, each.published) for each in DIFFERENCES if each.in_model}


@pytest.fixture(scope="module")
def theirs(request: pytest.FixtureRequest) -> Model:
    return json.loads(published_files(request.config)["service-2.json"])


@pytest.fixture(scope="module")
def ours() -> Model:
    return service_model()


def test_there_are_57_operations_and_290_shapes_and_only_documented_ones_more(ours: Model, theirs: Model) -> None:
    assert ours["operations"].keys() == theirs["operations"].keys()
    assert len(ours["operations"]) == 57
    assert len(theirs["shapes"]) == 290
    assert theirs["shapes"].keys() <= ours["shapes"].keys()
    documented = {each.where for each in DIFFERENCES if each.published is None and not {".", ":"} & set(each.where)}
    assert ours["shapes"].keys() - theirs["shapes"].keys() == documented
    assert documented >= {"ApplicationReference", "JobRequirement", "Seed", "VideoPolicy"}


def test_the_models_differ_where_it_is_documented_and_nowhere_else(ours: Model, theirs: Model) -> None:
    assert differences(ours, theirs) == DOCUMENTED


def test_every_difference_is_documented_once_and_has_a_reason() -> None:
    assert len({each.where for each in DIFFERENCES}) == len(DIFFERENCES)
    assert [each.where for each in DIFFERENCES if not each.reason.endswith(".")] == []


def test_paginators_are_the_published_ones(request: pytest.FixtureRequest) -> None:
    theirs = json.loads(published_files(request.config)["paginators-1.json"])

    assert paginators_model() == theirs
    assert len(theirs["pagination"]) == 11


def _set(path: str, value: Any) -> Callable[[Model], None]:
    *steps, last = path.split("/")

    def alter(model: Model) -> None:
        for step in steps:
            model = model[step]
        assert model.get(last) != value
        model[last] = value

    return alter


def _drop(path: str) -> Callable[[Model], None]:
    *steps, last = path.split("/")

    def alter(model: Model) -> None:
        for step in steps:
            model = model[step]
        del model[last]

    return alter


@pytest.mark.parametrize(
    "alter",
    [
        _drop("operations/ListTagsForResource"),
        _drop("operations/CreateFleet/deprecated"),
        _set("operations/CreateFleet/http/method", "PUT"),
        _set("operations/TagResource/http/requestUri", "/tags"),
        _set("operations/CreateFleet/errors", []),
        _set("operations/CreateFleet/input/shape", "CreateRobotRequest"),
        _drop("shapes/WorldFailure"),
        _drop("shapes/WorldFailure/members/failureCount"),
        _set("shapes/WorldFailure/members/failureCount/shape", "GenericInteger"),
        _set("shapes/WorldFailure/required", ["failureCount"]),
        _set("shapes/Name/pattern", "[a-z]*"),
        _set("shapes/Name/max", 254),
        _drop("shapes/Name/min"),
        _set("shapes/Robots/max", 999),
        _set("shapes/Robots/member/shape", "Fleet"),
        _set("shapes/TagMap/value/shape", "TagKey"),
        _set("shapes/PercentDone/type", "double"),
        _set("shapes/JobDuration/type", "integer"),
        _set("shapes/ExitBehavior/enum", ["FAIL"]),
        _set("shapes/ThrottlingException/error/httpStatusCode", 429),
        _drop("shapes/ThrottlingException/exception"),
        _drop("shapes/UntagResourceRequest/members/tagKeys/location"),
        _set("shapes/UntagResourceRequest/members/resourceArn/location", "querystring"),
        _drop("shapes/CreateSimulationJobRequest/members/clientRequestToken/idempotencyToken"),
        _set("shapes/CreateWorldTemplateRequest/members/clientRequestToken/idempotencyToken", True),
        _drop("shapes/LoggingConfig/members/recordAllRosTopics/deprecated"),
        _drop("shapes/Tool/members/streamUI"),
        _set("shapes/JobDuration/max", 691200),
        _set("shapes/Undocumented", {"type": "string"}),
        _set("metadata/apiVersion", "2018-06-30"),
    ],
)
def test_every_kind_of_difference_is_seen(alter: Callable[[Model], None], ours: Model, theirs: Model) -> None:
    altered = copy.deepcopy(ours)
    alter(altered)

    assert differences(altered, theirs) != DOCUMENTED


def test_a_documented_difference_that_is_gone_is_seen(ours: Model, theirs: Model) -> None:
    altered = copy.deepcopy(ours)
    del altered["shapes"]["CreateSimulationJobRequest"]["members"]["seed"]

    assert DOCUMENTED.items() - differences(altered, theirs).items() == {
        ("CreateSimulationJobRequest.seed", ("Seed", None))
    }
