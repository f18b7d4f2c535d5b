"""The operations against the service's last published model."""

import copy
import json
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import pytest
from helpers.published_model import Model, published_files

from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.schemas.wire.operation_shape import OperationShape
from tools.reference.differences import changed_bounds, changed_members

Schema = dict[str, Any]

EXTENSIONS = changed_members()
BOUNDS = changed_bounds()
# In Java's regular expressions `.` is no line break; nothing else is meant by these.
ANYTHING = (".*", ".+", r"[\S\s]+")


def differences(operation: OperationShape, model: Model) -> list[str]:
    """Everything in which an operation is not what the model says."""
    published = model["operations"][operation.name]
    found = []
    if (operation.method, operation.path) != (published["http"]["method"], published["http"]["requestUri"]):
        found.append(f"HTTP: {operation.method} {operation.path}")
    ours = {each.__name__ for each in operation.errors}
    if ours != {each["shape"] for each in published["errors"]}:
        found.append(f"errors: {sorted(ours)}")
    found += [
        f"status of {error.__name__}: {error.status}"
        for error in operation.errors
        if error.status != model["shapes"][error.__name__]["error"]["httpStatusCode"]
    ]
    for shape_class, shape, is_request in (
        (operation.request, published["input"]["shape"], True),
        (operation.response, published["output"]["shape"], False),
    ):
        schema = shape_class.model_json_schema()
        found += Comparison(model["shapes"], schema.get("$defs", {}), is_request).compare(schema, shape, shape)
    return found


class Comparison:
    """Compares the JSON Schema of our shapes with the shapes of the model."""

    def __init__(self, shapes: Mapping[str, Any], definitions: Mapping[str, Schema], is_request: bool) -> None:
        self._shapes = shapes
        self._definitions = definitions
        self._is_request = is_request

    def compare(self, ours: Schema, name: str, path: str) -> Iterator[str]:
        if "$ref" in ours:
            ours = self._definitions[ours["$ref"].rpartition("/")[-1]]
        shape = self._shapes[name]
        yield from getattr(self, f"_{shape['type']}")(ours, shape, name, path)

    def _structure(self, ours: Schema, shape: Model, name: str, path: str) -> Iterator[str]:
        yield from _equal(f"{path} (class name)", ours.get("title"), name)
        extensions = EXTENSIONS.get(name, frozenset())
        members = ours.get("properties", {})
        yield from _equal(f"{path} (members)", members.keys() - extensions, shape["members"].keys() - extensions)
        yield from _equal(f"{path} (required)", set(ours.get("required", ())), set(shape.get("required", ())))
        for member, reference in shape["members"].items():
            if member in members and member not in extensions:
                yield from self.compare(_present(members[member]), reference["shape"], f"{path}.{member}")
                yield from _equal(
                    f"{path}.{member} (deprecated)",
                    members[member].get("deprecated", False),
                    reference.get("deprecated", False),
                )

    def _list(self, ours: Schema, shape: Model, name: str, path: str) -> Iterator[str]:
        yield from _equal(f"{path} (type)", ours.get("type"), "array")
        bounds = (ours.get("minItems", 0), ours.get("maxItems"))
        published = (shape.get("min", 0), shape.get("max"))
        if self._is_request or bounds != (0, None):
            yield from _equal(f"{path} (length)", bounds, published)
        yield from self.compare(ours["items"], shape["member"]["shape"], f"{path}[]")

    def _map(self, ours: Schema, shape: Model, name: str, path: str) -> Iterator[str]:
        yield from _equal(f"{path} (entries)", ours.get("maxProperties"), shape.get("max"))
        [(pattern, value)] = ours["patternProperties"].items()
        key = {**ours["propertyNames"], "pattern": pattern, "type": "string"}
        yield from self.compare(key, shape["key"]["shape"], f"{path} (key)")
        yield from self.compare(value, shape["value"]["shape"], f"{path} (value)")

    def _string(self, ours: Schema, shape: Model, name: str, path: str) -> Iterator[str]:
        yield from _equal(f"{path} (type)", ours.get("type"), "string")
        if "enum" in shape:
            enum = [ours["const"]] if "const" in ours else ours.get("enum")
            yield from _equal(f"{path} (enum)", enum, shape["enum"])
            return
        yield from _equal(f"{path} (length)", (ours.get("minLength"), ours.get("maxLength")), _bounds(shape))
        pattern = shape.get("pattern")
        expected = None if pattern is None or pattern in ANYTHING else f"^(?:{pattern})$"
        yield from _equal(f"{path} (pattern)", ours.get("pattern"), expected)

    def _integer(self, ours: Schema, shape: Model, name: str, path: str) -> Iterator[str]:
        expected_type = "number" if shape["type"] == "float" else "integer"
        yield from _equal(f"{path} (type)", ours.get("type"), expected_type)
        expected = BOUNDS.get(path, BOUNDS.get(name, _bounds(shape)))
        yield from _equal(f"{path} (bounds)", (ours.get("minimum"), ours.get("maximum")), expected)

    _long = _float = _integer

    def _boolean(self, ours: Schema, shape: Model, name: str, path: str) -> Iterator[str]:
        yield from _equal(f"{path} (type)", ours.get("type"), "boolean")

    def _timestamp(self, ours: Schema, shape: Model, name: str, path: str) -> Iterator[str]:
        yield from _equal(f"{path} (type)", (ours.get("type"), ours.get("format")), ("string", "date-time"))


def _present(schema: Schema) -> Schema:
    """The schema of a member that is there."""
    if "anyOf" not in schema:
        return schema
    [present] = [each for each in schema["anyOf"] if each != {"type": "null"}]
    return present


def _bounds(shape: Model) -> tuple[Any, Any]:
    return shape.get("min"), shape.get("max")


def _equal(what: str, ours: object, published: object) -> Iterator[str]:
    if ours != published:
        yield f"{what}: ours {ours!r}, published {published!r}"


@pytest.fixture(scope="session")
def model(request: pytest.FixtureRequest) -> Model:
    return json.loads(published_files(request.config)["service-2.json"])


@pytest.mark.parametrize("name", OPERATIONS)
def test_operation_is_what_the_service_published(name: str, model: Model) -> None:
    assert differences(OPERATIONS[name], model) == []


def _alter(path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    *steps, last = path.split("/")

    def alter(model: dict[str, Any]) -> None:
        for step in steps:
            model = model[step]
        assert model[last] != value
        model[last] = value

    return alter


@pytest.mark.parametrize(
    "alter",
    [
        _alter("shapes/Name/pattern", "[a-z]*"),
        _alter("shapes/TagKey/max", 127),
        _alter("shapes/TagMap/max", 51),
        _alter("shapes/Port/min", 0),
        _alter("shapes/DataSourceConfigs/max", 5),
        _alter("shapes/ExitBehavior/enum", ["FAIL"]),
        _alter("shapes/PortMapping/required", ["jobPort"]),
        _alter("shapes/Tool/members", {"name": {"shape": "Name"}, "command": {"shape": "UnrestrictedCommand"}}),
        _alter("shapes/VPCConfig/members/assignPublicIp/shape", "Name"),
        _alter("shapes/LimitExceededException/error/httpStatusCode", 429),
        _alter("operations/CreateSimulationJob/http/requestUri", "/simulationJob"),
        _alter("operations/CreateSimulationJob/errors", []),
    ],
)
def test_comparison_sees_every_kind_of_difference(
    alter: Callable[[dict[str, Any]], None], model: dict[str, Any]
) -> None:
    altered = copy.deepcopy(model)
    alter(altered)

    assert differences(OPERATIONS["CreateSimulationJob"], altered) != []
