"""Tables of results as tests want them: a few rows, each with what differs from a trial that passed."""

import json
from collections.abc import Callable, Sequence
from typing import Any

import pyarrow as pa
import pytest

from prefect_robomaker.tasks.results.table import ResultTable

Row = dict[str, Any]


def missed(name: str = "polite", **more: Any) -> dict[str, Any]:
    return {"name": name, "satisfied": False, "detail": "", **more}


def table_of(rows: Sequence[Row]) -> ResultTable:
    """Makes a table; a row may have most columns, `axes`, `requirements` and `margin`."""
    names = sorted({name for row in rows for name in row.get("axes", {})})
    columns: dict[str, list[Any]] = {name: [] for name in ("step", "test", "job", "world", "world_name", "outcome")}
    others = (
        "output",
        "trial",
        "seed",
        "sim_time_s",
        "ended_by",
        "verdict",
        "state_digest",
        "requirements",
        "requirement.polite",
        "margin.polite",
    )
    columns |= {name: [] for name in (*others, *(f"axis.{name}" for name in names))}
    for number, row in enumerate(rows):
        world, outcome = row.get("world", 0), row.get("outcome", "passed")
        margin = row.get("margin", -0.1 if outcome == "failed" else 0.1)
        polite = {"name": "polite", "satisfied": outcome != "failed", "detail": "", "margin": margin, "unit": "m"}
        asked = row.get("requirements", [polite])
        job, trial = row.get("job", f"sim-{world}"), row.get("trial", number)
        own = {
            "step": "drive", "test": f"world-{world}", "job": job, "world": f"content-{world}",
            "world_name": row.get("world_name", f"world-{world}"), "outcome": outcome, "output": row.get("output"),
            "trial": trial,
            "seed": row.get("seed", number), "sim_time_s": row.get("end_s"), "ended_by": row.get("ended_by"),
            "verdict": "FAIL" if outcome == "failed" else "PASS",
            "state_digest": row.get("state_digest"), "requirements": json.dumps(asked),
            "requirement.polite": outcome != "failed", "margin.polite": margin,
        }  # fmt: skip
        own |= {f"axis.{name}": row.get("axes", {}).get(name) for name in names}
        for name, values in columns.items():
            values.append(own[name])
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    return ResultTable(table.column_names, table.num_rows, table.column)


@pytest.fixture
def made() -> Callable[[Sequence[Row]], ResultTable]:
    return table_of


@pytest.fixture
def miss() -> Callable[..., dict[str, Any]]:
    return missed
