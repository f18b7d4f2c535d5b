"""Documents: every member is described and typed, versions are read, and nothing else opens what the catalog keeps."""

import importlib
import inspect
import pkgutil
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest
from pydantic import BaseModel, Field, ValidationError

from prefect_robomaker.schemas import documents
from prefect_robomaker.schemas.documents.document_base import Document, Migration
from prefect_robomaker.schemas.documents.simulation_jobs import Outcome, SimulationJobDocument, SimulationJobProgress
from prefect_robomaker.schemas.wire.errors import ConfigurationError

MODULES = [
    importlib.import_module(f"{documents.__name__}.{each.name}") for each in pkgutil.iter_modules(documents.__path__)
]
MODELS = {
    model
    for module in MODULES
    for _, model in inspect.getmembers(module, inspect.isclass)
    if issubclass(model, BaseModel) and model.__module__ == module.__name__
}
RAW = re.compile(r"\.document\b")


@dataclass
class Kept:
    document: dict[str, Any]
    arn: str = "arn:aws:robomaker:us-east-1:111122223333:simulation-job/sim-1"


class Second(Document):
    """A document whose second version has another name for a member."""

    MIGRATIONS: ClassVar[tuple[Migration, ...]] = (lambda stored: {"size": stored["length"]},)

    schema_version: int = Field(default=2, description="Version.")  # pyright: ignore[reportIncompatibleVariableOverride]
    size: int = Field(description="Size.")


@pytest.mark.parametrize("model", sorted(MODELS, key=str), ids=str)
def test_every_member_is_described(model: type[BaseModel]) -> None:
    assert model.__doc__
    assert [name for name, field in model.model_fields.items() if not field.description] == []


def test_changes_set_only_what_is_given() -> None:
    assert SimulationJobProgress(failure_code=None, run_id="r").to_json() == {"failureCode": None, "runId": "r"}
    outcome = Outcome(status="Failed", failure_code="InvalidInput")
    assert outcome.announced(finished=False).to_json() == {
        "failureCode": "InvalidInput",
        "ending": {"status": "Failed", "failureCode": "InvalidInput"},
        "finished": False,
    }


def test_a_misspelt_change_is_refused() -> None:
    with pytest.raises(ValidationError, match="run_identity"):
        SimulationJobProgress(run_identity="r")  # type: ignore[call-arg]


def test_a_document_is_stored_with_its_version() -> None:
    assert SimulationJobDocument(request={"a": [None]}, seed=1).to_json() == {
        "schema_version": 1,
        "request": {"a": [None]},
        "seed": 1,
    }


def test_documents_of_earlier_versions_are_migrated() -> None:
    assert Second.of(Kept({"length": 3})).size == 3
    assert Second.of(Kept({"size": 4, "schema_version": 2})).size == 4


def test_a_document_of_a_newer_release_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="sim-1 has version 2, this program knows 1; update"):
        SimulationJobDocument.of(Kept({"request": {}, "seed": 1, "schema_version": 2}))


@pytest.mark.parametrize("folder", ["tasks", "flows", "deployments"])
def test_only_the_catalog_opens_stored_documents(folder: str) -> None:
    """All others read them by their types."""
    root = Path(__file__).parents[2] / folder
    readers = [path for path in root.rglob("*.py") if "catalog" not in path.parts and RAW.search(path.read_text())]
    assert [str(path.relative_to(root)) for path in readers] == []
