"""schema."""

import json

import pytest

from prefect_robomaker.schemas.operations.registry import OPERATIONS


def test_schema_prints_the_pipelines_or_an_operations(robomaker) -> None:
    assert json.loads(robomaker("schema").out)["title"] == "RoboMaker pipeline"
    assert json.loads(robomaker("schema", "create-world-template").out)["title"] == "CreateWorldTemplateRequest"
    wrong = robomaker("schema", "CreateWorldTemplat")
    assert wrong.code == 2
    assert "did you mean 'CreateWorldTemplate'?" in wrong.err


@pytest.mark.parametrize("operation", sorted(OPERATIONS))
def test_every_operation_has_a_schema(robomaker, operation: str) -> None:
    assert json.loads(robomaker("schema", operation).out)["type"] == "object"
