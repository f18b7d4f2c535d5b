"""Plans that a process draws: one that ends or hangs is replaced, and nobody has too many."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from prefect_robomaker.deployments.console.orders import previews
from prefect_robomaker.deployments.console.orders.previews import MOST_A_MINUTE, NoPlanError, Previews
from prefect_robomaker.schemas.wire.errors import ThrottlingException

PROGRAM = """
import json, os, sys, time
for line in sys.stdin:
    asked = json.loads(line)["body"]
    if asked == "die": os._exit(1)
    if asked == "hang": time.sleep(600)
    print(json.dumps({"error": "no room"} if asked == "none" else {"svg": f"{asked} {os.getpid()}"}), flush=True)
"""


@pytest.fixture
def now() -> list[float]:
    return [0.0]


@pytest.fixture
def plans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, now: list[float]) -> Iterator[Previews]:
    (tmp_path / "stand_in_plans.py").write_text(PROGRAM)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with closing(Previews(lambda: now[0], "stand_in_plans")) as plans:
        yield plans


def test_one_process_draws_all_and_a_dead_one_is_replaced(plans: Previews) -> None:
    first, second = plans.draw("a", 1, "me"), plans.draw("b", 1, "me")
    assert first.split()[1] == second.split()[1]
    with pytest.raises(NoPlanError, match="no room"):
        plans.draw("none", 1, "me")
    with pytest.raises(NoPlanError, match="could not be drawn"):
        plans.draw("die", 1, "me")
    assert plans.draw("c", 1, "me").startswith("c ")


def test_one_that_hangs_is_killed(plans: Previews, monkeypatch: pytest.MonkeyPatch) -> None:
    plans.draw("a", 1, "me")
    monkeypatch.setattr(previews, "_PATIENCE_S", 0.1)
    with pytest.raises(NoPlanError):
        plans.draw("hang", 1, "me")
    monkeypatch.setattr(previews, "_PATIENCE_S", 240.0)
    assert plans.draw("c", 1, "me").startswith("c ")


def test_a_visitor_has_so_many_a_minute(plans: Previews, now: list[float]) -> None:
    for _ in range(MOST_A_MINUTE):
        plans.draw("a", 1, "me")
    with pytest.raises(ThrottlingException, match="within a minute"):
        plans.draw("a", 1, "me")
    assert plans.draw("a", 1, "another")
    now[0] = 61.0
    assert plans.draw("a", 1, "me")
