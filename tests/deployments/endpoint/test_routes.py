"""Which operation a method and a path mean."""

import pytest

from prefect_robomaker.deployments.endpoint.protocol_errors import (
    MethodNotAllowedException,
    SerializationException,
    UnknownOperationException,
)
from prefect_robomaker.deployments.endpoint.wire import Router
from prefect_robomaker.schemas.operations.registry import OPERATIONS

ARN = "arn:aws:robomaker:us-east-1:000000000000:world/generation-1/world-1"
ROUTER = Router(OPERATIONS.values())


@pytest.mark.parametrize("name", OPERATIONS)
def test_every_operation_is_found_at_its_path(name: str) -> None:
    operation = OPERATIONS[name]
    route = ROUTER.find(operation.method, operation.path.replace("{resourceArn}", "arn"))

    assert route.operation is operation


@pytest.mark.parametrize(
    "encoded",
    [
        ARN,
        ARN.replace("/", "%2F"),
        ARN.replace("/", "%2f").replace(":", "%3A"),
        "".join(f"%{byte:02X}" for byte in ARN.encode()),
    ],
)
def test_arn_in_the_path_is_decoded(encoded: str) -> None:
    assert ROUTER.find("GET", f"/tags/{encoded}").members == {"resourceArn": ARN}


def test_members_are_decoded_once() -> None:
    assert ROUTER.find("GET", "/tags/a%252Fb").members == {"resourceArn": "a%2Fb"}


@pytest.mark.parametrize(
    "path",
    ["", "/", "/listworlds", "/ListWorlds", "/listWorlds/", "//listWorlds", "/list%57orlds", "/tags", "/tags/", "/é"],
)
def test_other_paths_have_no_operation(path: str) -> None:
    with pytest.raises(UnknownOperationException):
        ROUTER.find("POST", path)


def test_misspelt_paths_are_told_the_nearest() -> None:
    with pytest.raises(UnknownOperationException, match="did you mean '/listWorlds'"):
        ROUTER.find("POST", "/listworlds")


def test_other_methods_are_told_what_is_allowed() -> None:
    with pytest.raises(MethodNotAllowedException) as refused:
        ROUTER.find("PATCH", "/tags/arn")

    assert refused.value.headers == ((b"allow", b"DELETE, GET, POST"),)
    assert refused.value.code == "UnknownOperationException"


def test_members_in_the_path_have_to_be_utf_8() -> None:
    with pytest.raises(SerializationException, match="resourceArn"):
        ROUTER.find("GET", "/tags/%FF")
