"""What worlds cost and how they differ; prints figures and asserts no time.

All times are CPU time. `calibration` is what a loop of plain Python takes at the same moment: on a busy machine both
grow, and their ratio tells more than either.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import hashlib
import json
import multiprocessing
import os
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from helpers.many_plans import ENOUGH

from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.worlds.world import World
from prefect_robomaker.tasks.operations.registry import call, registry
from prefect_robomaker.tasks.runtime.robots.scout import PREFIX, build_scout
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worldforge.bundle.bundle import write_bundle
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.floorplans.plan_signature import signature_of
from prefect_robomaker.tasks.worldforge.generator import generate_world, seeds_for
from prefect_robomaker.tasks.worldforge.interiors.interior import furnish
from prefect_robomaker.tasks.worldforge.model.mjcf import world_mjcf
from prefect_robomaker.tasks.worldforge.pictures.preview import render_preview

WORLDS = 12
STEPS = 20_000
SEEDS = 1000
FRESH = 9
"""Processes that make one world; their median is steady to a tenth."""
THOUSAND, LOOPS = 1000, 50
FLAT = (
    ("Living Room", "Living", 26.0),
    ("Kitchen", "Kitchen", 14.0),
    ("Bedroom", "Bedroom", 16.0),
    ("Bath", "Bathroom", 10.0),
)
HOUSE = (
    ("Hallway", "Hallway", 14.0),
    ("Living", "Living", 32.0),
    ("Kitchen", "Kitchen", 16.0),
    ("Bedroom", "Bedroom", 18.0),
    ("Guest room", "Bedroom", 13.0),
    ("Bathroom", "Bathroom", 10.0),
)


def template(kind: str) -> dict[str, Any]:
    """A flat with one bedroom, or a house of six rooms, densely furnished."""
    rooms = FLAT if kind == "flat" else HOUSE
    shape = {"AspectRatio": {"x": 4.0, "y": 3.0}}
    floor: dict[str, Any] = {
        "Floorplan": {
            "Rooms": [{"Name": name, "Type": of, "DesiredShape": {"Area": area, **shape}} for name, of, area in rooms]
        }
    }
    if kind == "house":
        everywhere = {"RoomNames": [name for name, _, _ in rooms]}
        dense = {"Name": "dense", "TargetSet": everywhere, "DesiredSpatialDensity": "Dense"}
        floor["Interior"] = {"Furniture": {"FurnitureArrangements": [dense]}}
    return {"Buildings": [{"Floors": [floor]}]}


def calibration_ms() -> float:
    """CPU time of a loop of plain Python."""
    start = time.process_time()
    total = 0
    for number in range(300_000):
        total += number * number
    return 1e3 * (time.process_time() - start)


class Meter:
    """Takes CPU times of work on several worlds, and of the calibration in between."""

    def __init__(self) -> None:
        self.calibration: list[float] = []

    def __call__(self, work: Callable[[int], object]) -> tuple[float, float]:
        """Median and worst of the milliseconds per world."""
        work(WORLDS)
        times = []
        for index in range(WORLDS):
            self.calibration.append(calibration_ms())
            start = time.process_time()
            work(index)
            times.append(1e3 * (time.process_time() - start))
        return float(np.median(times)), max(times)


@pytest.mark.benchmark
@pytest.mark.parametrize("kind", ["flat", "house"])
def test_what_a_world_costs(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body = WorldTemplateBody.model_validate(template(kind))
    worlds = [generate_world(body, *seeds_for(7, index, 0)) for index in range(WORLDS + 1)]
    plans = [generate_floorplan(body, world.floorplan_seed) for world in worlds]
    meter = Meter()
    figures = {
        "floor plan": meter(lambda i: generate_floorplan(body, i)),
        "interior": meter(lambda i: furnish(body, plans[i], np.random.default_rng(i))),
        "writing MJCF": meter(lambda i: world_mjcf(worlds[i])),
        "compiling it": meter(lambda i: mujoco.MjModel.from_xml_string(world_mjcf(worlds[i]))),
        "world without the settle": meter(lambda i: generate_world(body, *seeds_for(7, i, 0), settle=False)),
        "world with every proof": meter(lambda i: generate_world(body, *seeds_for(7, i, 0))),
        "bundle without preview": meter(lambda i: write_bundle(worlds[i], tmp_path / f"{i}")),
        "preview": meter(lambda i: render_preview(worlds[i])),
    }
    geoms = [world.checks.geoms for world in worlds if world.checks]
    pieces = [len(world.furniture) for world in worlds]
    with capsys.disabled():
        print(f"\n{kind}: calibration {np.median(meter.calibration):.1f} ms")
        for name, (median, worst) in figures.items():
            print(f"  {name:26s} {median:6.1f} ms median, {worst:6.1f} ms worst, {1e3 / median:5.1f} a second")
        print(f"  {np.median(geoms):.0f} geoms in the median, {max(geoms)} at most; {np.median(pieces):.0f} pieces")
    assert max(geoms) < 1500


@pytest.mark.benchmark
@pytest.mark.parametrize("kind", ["flat", "house"])
def test_what_the_first_world_of_a_process_costs(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each is made in a process of its own, which has imported everything and made nothing."""
    costs = []
    for index in range(FRESH):
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            costs.append(pool.submit(first_world, kind, index, tmp_path / f"{index}").result())
    search, proof, bundle = np.array(costs).T
    bundled, whole = (proof + bundle) / proof, (search + proof + bundle) / (search + proof)
    with capsys.disabled():
        print(
            f"\n{kind}, first of a process, CPU: plans {np.median(search):.0f} ms; furnished and proven "
            f"{np.median(proof):.0f} ms; bundle {np.median(bundle):.0f} ms; bundled {np.median(bundled):.2f} times the "
            f"proven one, {bundled.max():.2f} at most, and {np.median(whole):.2f} with the "
            f"search for plans"
        )


def first_world(kind: str, index: int, folder: Path) -> tuple[float, float, float]:
    """CPU milliseconds of the search for a template's plans, of furnishing and proving one, and of its bundle."""
    body, seeds = WorldTemplateBody.model_validate(template(kind)), seeds_for(7, index, 0)
    times = [time.process_time()]
    generate_floorplan(body, seeds[0])
    times.append(time.process_time())
    world = generate_world(body, *seeds)
    times.append(time.process_time())
    write_bundle(world, folder)
    times.append(time.process_time())
    searched, proven, bundled = (1e3 * (after - before) for before, after in pairwise(times))
    return searched, proven, bundled


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_what_a_thousand_flats_take(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        list(pool.map(calibration_of, range(2)))  # both have started
        begun = time.monotonic()
        parts = list(pool.map(flats_of, [tmp_path] * 2, range(2)))
        wall = time.monotonic() - begun
    loops, flats = (sum(each) for each in zip(*parts, strict=True))
    with capsys.disabled():
        print(
            f"\n{THOUSAND} flats with every proof, map and bundle: {wall:.1f} s in two processes, "
            f"{1e3 * flats / THOUSAND:.1f} CPU-ms a flat, {flats / loops * LOOPS / THOUSAND:.2f} loops of plain Python "
            f"({1e3 * loops / LOOPS:.1f} ms)"
        )


def calibration_of(_: int) -> float:
    return calibration_ms()


def flats_of(folder: Path, first: int) -> tuple[float, float]:
    """CPU seconds of the loops and of every second flat."""
    body, loops, flats = WorldTemplateBody.model_validate(template("flat")), 0.0, 0.0
    for index in range(first, THOUSAND, 2):
        if index % (2 * THOUSAND // LOOPS) == first:
            loops += 1e-3 * calibration_ms()
        start = time.process_time()
        write_bundle(generate_world(body, *seeds_for(7, index, 0)), folder / f"{index}")
        flats += time.process_time() - start
    return loops, flats


@pytest.mark.benchmark
@pytest.mark.parametrize("kind", ["flat", "house"])
def test_how_fast_a_world_runs_with_scout(kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    body = WorldTemplateBody.model_validate(template(kind))
    rates = []
    for index in range(5):
        world = generate_world(body, *seeds_for(7, index, 0), settle=False)
        rates.append((steps_per_second(world), calibration_ms()))
    with capsys.disabled():
        each = ", ".join(f"{rate / 1e3:.0f}k ({calibration:.0f} ms)" for rate, calibration in rates)
        print(f"\n{kind} with Scout, steps a second in the C loop (and calibration): {each}")


def steps_per_second(world: World) -> float:
    """Steps per CPU second while Scout drives in circles and everything else sleeps."""
    spec = mujoco.MjSpec.from_string(world_mjcf(world))
    spec.worldbody.add_frame().attach_body(build_scout().body("base"), PREFIX, "")
    model = spec.compile()
    # As simulation jobs do: what nothing touches sleeps.
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    loose = [model.body_treeid[model.body(item.id).id] for item in world.furniture if item.movable]
    model.tree_sleep_policy[loose] = mujoco.mjtSleepPolicy.mjSLEEP_INIT
    data = mujoco.MjData(model)
    data.ctrl[:2] = 3.0, 2.0
    mujoco.mj_step(model, data, nstep=500)
    start = time.process_time()
    mujoco.mj_step(model, data, nstep=STEPS)
    return STEPS / (time.process_time() - start)


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_how_much_worlds_of_one_template_differ(capsys: pytest.CaptureFixture[str]) -> None:
    body = WorldTemplateBody.model_validate(template("flat"))
    hashes, graphs, plans, failed = set(), set(), set(), 0
    begun = time.process_time()
    for index in range(SEEDS):
        world = generate_world(body, *seeds_for(11, index, 0), settle=False)
        assert world.checks is not None
        hashes.add(hashlib.sha256(world_mjcf(world).encode()).digest())
        graphs.add(frozenset((frozenset(way.rooms), way.kind) for way in world.checks.room_graph))
        plans.add(signature_of(world.floorplan).key)
        failed += world.interior_attempt > 0
    each_ms = 1e3 * (time.process_time() - begun) / SEEDS
    with capsys.disabled():
        print(
            f"\n{SEEDS} seeds: {len(hashes)} different models, {len(graphs)} different room graphs, "
            f"{len(plans)} different plans; {failed} needed another interior; "
            f"{each_ms:.1f} ms each (calibration {calibration_ms():.1f} ms)"
        )
    assert len(hashes) == SEEDS
    assert len(plans) >= ENOUGH


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_what_a_job_of_fifty_worlds_costs(
    service: Service, prefect_server: str, capsys: pytest.CaptureFixture[str]
) -> None:
    del prefect_server
    made = call("CreateWorldTemplate", {"name": "flat", "templateBody": json.dumps(template("flat"))}, service)["arn"]
    count = {"floorplanCount": 10, "interiorCountPerFloorplan": 5}
    arn = call("CreateWorldGenerationJob", {"template": made, "worldCount": count, "seed": 7}, service)["arn"]
    before = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    begun, load, calibration = time.monotonic(), os.getloadavg()[0], calibration_ms()
    job = registry()["CreateWorldGenerationJob"].perform(arn, service)
    wall = time.monotonic() - begun
    after = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    own, builders = (
        new.ru_utime + new.ru_stime - old.ru_utime - old.ru_stime for new, old in zip(after, before, strict=True)
    )
    assert job["status"] == "Completed"
    with capsys.disabled():
        print(
            f"\n50 worlds with previews, stored: {wall:.1f} s on {os.cpu_count()} cores at a load of {load:.1f}; CPU "
            f"{builders:.1f} s in builders, {own:.1f} s in the job worker (calibration {calibration:.1f} ms)"
        )
