"""The promised surfaces: what each is made of, and how its facts are found in the program."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import get_args

from pydantic import BaseModel
from sqlalchemy import Column, Table

import prefect_robomaker
from prefect_robomaker.schemas.documents.document_base import Document
from prefect_robomaker.schemas.documents.kinds import DOCUMENTS
from prefect_robomaker.schemas.operations.registry import OPERATIONS
from prefect_robomaker.schemas.reports.run_record import CaseOutcome, JobRecord, Order, RunRecord
from prefect_robomaker.schemas.runs.plan import Requirement, RunPlan, RunResult, Verdict
from prefect_robomaker.schemas.runs.provenance import FailureState, Manifest, Provenance
from prefect_robomaker.schemas.runs.trial_rows import TrialRow
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.schemas.specs.json_schema import spec_schema
from prefect_robomaker.schemas.wings import parts_of_wings
from prefect_robomaker.schemas.worlds.description import WorldDescription
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.catalog.database import FIRST_VERSION, MIGRATIONS
from prefect_robomaker.tasks.catalog.tables import metadata
from prefect_robomaker.tasks.results.columns import Names, schema_of
from prefect_robomaker.tasks.results.table import ResultTable
from tools.reference.settings_page import COMPUTED, ELSEWHERE, NEITHER

from .facts import Fact, Facts
from .from_schemas import facts_of_definitions, facts_of_models
from .python_names import facts_of_names


def requests_of_wire() -> Facts:
    """Returns the facts of what clients send."""
    return facts_of_models((operation.request for operation in OPERATIONS.values()), "taken")


def responses_of_wire() -> Facts:
    """Returns the facts of what clients get."""
    return facts_of_models((operation.response for operation in OPERATIONS.values()), "given")


def operations_of_wire() -> Facts:
    """Returns the facts of the operations: address, places of members, errors with their status, pages."""
    facts: dict[str, Fact] = {}
    for name, shape in OPERATIONS.items():
        facts[name] = Fact(form=f"{shape.method} {shape.path}")
        facts |= {f"{name} takes {member}": Fact(form=f"in the {where}") for member, where in shape.locations.items()}
        facts |= {f"{name} raises {error.__name__}": Fact(form=str(error.status)) for error in shape.errors}
        if shape.result_key:
            facts[f"{name} has pages"] = Fact(form=f"of {shape.result_key}")
    return facts


def specification_language() -> Facts:
    """Returns the facts of specifications; members of requests that are written as on the wire are promised there."""
    schema = spec_schema()
    definitions = {**schema["$defs"], "Spec": {key: schema["else"][key] for key in ("properties", "required")}}
    facts = facts_of_definitions(definitions, "taken")
    of_wire = requests_of_wire()
    return {name: fact for name, fact in facts.items() if not _is_as_on_the_wire(fact, of_wire.get(name))}


def _is_as_on_the_wire(fact: Fact, on_the_wire: Fact | None) -> bool:
    return (
        on_the_wire is not None
        and fact.taken is not None
        and {*fact.taken} - {"Reference", "forEach"} == {*(on_the_wire.taken or ())} - {"null"}
    )


def table_of_results() -> Facts:
    """Returns the facts of the columns of `results.parquet` and `trials.parquet`; names in capitals are the user's."""
    row = TrialRow(
        trial=0,
        seed=0,
        verdict="PASS",
        metrics={"METRIC": 0.0},
        requirements=[Requirement(name="REQUIREMENT", satisfied=True, detail="")],
    )
    trials = schema_of({"NUMBER": True, "TEXT": False}, Names.of([row]))
    results = ResultTable.of([JobRecord(label="LABEL", status="Completed")]).to_arrow().schema
    facts = {
        f"{table}.{column.name}": Fact(given=frozenset({str(column.type)}), required=True)
        for table, schema in (("results", results), ("trials", trials))
        for column in schema
    }
    for column, values in (("outcome", CaseOutcome), ("verdict", Verdict)):
        facts[f"results.{column} (values)"] = Fact(given=frozenset(map(json.dumps, get_args(values))), required=True)
    return facts


def python_names() -> Facts:
    """Returns the facts of the names that `prefect_robomaker` exports."""
    return facts_of_names(prefect_robomaker, OPERATIONS)


def settings() -> Facts:
    """Returns the facts of the settings' environment variables."""
    parts = [Settings, *(part.SETTINGS for part in parts_of_wings("schemas", "settings"))]
    facts = {name.strip("`"): Fact(taken=frozenset({"text"}), default=default) for name, _, default in ELSEWHERE}
    for model in parts:
        for name, fact in _own_members(model):
            if not name.startswith(NEITHER):
                facts[f"ROBOMAKER_{name.upper()}"] = _of_variable(fact, COMPUTED.get(name))
    return facts


def _of_variable(fact: Fact, computed: str | None) -> Fact:
    return fact if computed is None else replace(fact, required=False, default=computed)


def _own_members(model: type[BaseModel]) -> Iterator[tuple[str, Fact]]:
    own = f"{model.__name__}."
    for name, fact in facts_of_models([model], "taken").items():
        if name.startswith(own):
            yield name.removeprefix(own), fact


def homes() -> Facts:
    """Returns the facts of what is stored: tables of the catalog, documents in them, and files of runs and worlds."""
    facts: dict[str, Fact] = {"catalog": Fact(form="database", version=FIRST_VERSION + len(MIGRATIONS))}
    wings = [table for part in parts_of_wings("tasks", "tables") for table in part.TABLES]
    for table in [*metadata.sorted_tables, *wings]:
        facts |= {f"catalog.{table.name}.{column.name}": _of_column(table, column) for column in table.columns}
    models = [*DOCUMENTS.values(), *_FILES]
    stored = facts_of_models(models, "taken")
    for model in models:
        name = model.__name__
        if (version := stored.pop(f"{name}.schema_version", None)) is not None:
            number = len(model.MIGRATIONS) + 1 if issubclass(model, Document) else int(min(version.taken or {"1"}))
            facts[name] = Fact(form="stored document", version=number)
    return facts | stored


_FILES: Sequence[type[BaseModel]] = (
    *(FailureState, Manifest, Order, Provenance, RunPlan, RunRecord, RunResult, TrialRow, WorldDescription, World),
)
"""Models that read stored files: `failure.json`, `manifest.json`, and so on."""


def _of_column(table: Table, column: "Column[object]") -> Fact:
    is_counted = column is table.autoincrement_column
    has_default = column.nullable or column.server_default is not None or is_counted
    return Fact(taken=frozenset({str(column.type)}), required=not has_default)


SURFACES: Mapping[str, Callable[[], Facts]] = {
    "wire-requests": requests_of_wire,
    "wire-responses": responses_of_wire,
    "wire-operations": operations_of_wire,
    "specification": specification_language,
    "results": table_of_results,
    "python": python_names,
    "settings": settings,
    "homes": homes,
}
"""The promised surfaces, by the names of their files."""
