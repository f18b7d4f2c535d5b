"""Cost of watching the health of the physics beside a step; prints figures and asserts no time.

The least of several rounds counts: what else happens on a machine only ever makes things slower.
"""

import importlib.util
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from helpers.paths import BUNDLES, REPOSITORY
from ruamel.yaml import YAML

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import IndoorNavigation
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.navigation_task import NavigationTask
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.world_with_robot import assemble
from prefect_robomaker.tasks.runtime.episode.health import PhysicsHealth
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.runtime.robots.scout import SCOUT
from prefect_robomaker.tasks.worldforge.bundle.bundle import read_world, write_bundle
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for

ROUNDS, STEPS = 7, 400


def least_us(call: Callable[[], object], count: int = STEPS) -> float:
    """The least time of a call in microseconds, as the mean of a round."""
    times = []
    for _ in range(ROUNDS):
        begun = time.perf_counter()
        for _ in range(count):
            call()
        times.append((time.perf_counter() - begun) / count * 1e6)
    return min(times)


def report(name: str, environment: object, action: np.ndarray) -> None:
    health, step = PhysicsHealth(), environment.step  # type: ignore[attr-defined]
    timestep = step(action)
    times = iter(np.arange(1, 1e6) * 0.01)
    watched = least_us(lambda: health.watch(environment, float(next(times))))
    seen = least_us(lambda: health.look_at_timestep(timestep))
    whole = least_us(lambda: step(action))
    print(
        f"\n{name}: a step {whole:.1f} us, health {watched + seen:.2f} us ({watched:.2f} physics, {seen:.2f} "
        f"observations), {100 * (watched + seen) / whole:.2f} %"
    )


@pytest.mark.benchmark
def test_health_beside_a_step(tmp_path: Path) -> None:
    folder = tmp_path / "world"
    quickstart = YAML(typ="safe").load((REPOSITORY / "deployments" / "specs" / "quickstart.yaml").read_text())
    body = WorldTemplateBody.model_validate(quickstart["steps"]["template"]["input"]["templateBody"])
    write_bundle(generate_world(body, *seeds_for(7, 0, 0)), folder)
    task = NavigationTask(read_world(folder), SCOUT, np.random.default_rng(1), Recorder(), 1e6)
    flat = IndoorNavigation(assemble(folder / "world.xml", SCOUT), task, SCOUT)
    flat.reset()
    report("Scout in a flat", flat, np.array([0.1, 0.1]))

    swinger = _swinger()
    context = SimpleNamespace(rng=np.random.default_rng(1), recorder=Recorder(), environment={"TIME_LIMIT_S": "1e6"})
    pendulum = swinger.make_environment(context)
    pendulum.reset()
    report("a pendulum", pendulum, np.array([0.1]))


def _swinger() -> ModuleType:
    spec = importlib.util.spec_from_file_location("swinger", BUNDLES / "swinger" / "swinger" / "__init__.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
