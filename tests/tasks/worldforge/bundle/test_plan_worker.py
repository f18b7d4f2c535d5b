"""The process that draws plans: the first world of a job, in a bounded time."""

import json
import signal
from collections.abc import Iterator

import pytest
from helpers.small_flat import BODY

from prefect_robomaker.schemas.templates.parsing import parse_template_body
from prefect_robomaker.tasks.worldforge.bundle import plan_worker
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for
from prefect_robomaker.tasks.worldforge.pictures.plan_svg import floorplan_svg

REQUEST: dict[str, str | int] = {"body": json.dumps(BODY), "seed": 3}


@pytest.fixture
def bounded() -> Iterator[None]:
    before = signal.signal(signal.SIGPROF, plan_worker._stop)
    yield
    signal.signal(signal.SIGPROF, before)


def test_the_plan_is_that_of_the_first_world(bounded: None) -> None:
    del bounded
    world = generate_world(parse_template_body(json.dumps(BODY)), *seeds_for(3, 0, 0))
    assert plan_worker.answer(REQUEST) == {"svg": floorplan_svg(world)}


def test_what_takes_too_long_is_given_up(bounded: None, monkeypatch: pytest.MonkeyPatch) -> None:
    del bounded
    monkeypatch.setattr(plan_worker, "MOST_CPU_S", 0.001)
    assert "is not shown" in plan_worker.answer(REQUEST)["error"]
    assert signal.getitimer(signal.ITIMER_PROF) == (0.0, 0.0)


def test_a_body_with_problems_has_no_plan(bounded: None) -> None:
    del bounded
    assert "not JSON" in plan_worker.answer({"body": "{", "seed": 1})["error"]
