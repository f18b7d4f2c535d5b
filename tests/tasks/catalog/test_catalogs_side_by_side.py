"""Several catalogs on one database in a process: opening one takes nothing from the others."""

import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

from prefect_robomaker.tasks.catalog import Catalog

READS = """
import sqlite3, sys
connection = sqlite3.connect(sys.argv[1])
connection.execute("SELECT count(*) FROM resources").fetchall()
connection.close()
"""


def now() -> datetime:
    return datetime(2026, 3, 1, tzinfo=UTC)


def test_a_catalog_that_is_opened_beside_another_leaves_that_its_locks(tmp_path: Path) -> None:
    """Else another process takes itself for the last one, and removes what this one still writes to."""
    path = tmp_path / "catalog.db"
    stays = Catalog.open(f"sqlite:///{path}", clock=now)
    assert stays.count() == {}
    Catalog.open(f"sqlite:///{path}", clock=now).close()

    subprocess.run([sys.executable, "-c", READS, path], check=True)

    assert path.with_name("catalog.db-wal").exists()
    assert stays.count() == {}
    stays.close()
