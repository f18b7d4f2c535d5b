"""What it costs to look at a fleet of 10,000 robots: the report of a deployment, and when robots polled last."""

import json
import os
import time

import pytest
from helpers.fleet_calls import Fleets
from helpers.simulated_rollouts import report_of, simulate

from prefect_robomaker.schemas.fleet.documents import RobotSighting
from prefect_robomaker.schemas.fleet.rollouts.rollout import Rollout
from prefect_robomaker.tasks.fleet.reporting.deployment_page import render_deployment
from prefect_robomaker.tasks.fleet.views.fleet_standings import find_fleet, fleet_standing
from prefect_robomaker.tasks.service.service import Service

ROBOTS = 10_000
SEEN_AT_ONCE = 1_000
"""Robots that poll every 30 s, in the 3 s between two writes."""


@pytest.mark.benchmark
def test_the_report_of_ten_thousand_robots() -> None:
    names = [f"robot-{number:05}" for number in range(ROBOTS)]
    rollout = simulate(names, bad=lambda number: number % 23 == 4, silent=lambda number: number % 91 == 1, threshold=40)
    stored = json.dumps(rollout.to_json())
    bare = rollout.model_copy(
        update={
            "robots": {
                arn: state.model_copy(update={"step_times": {}, "offered_s": None})
                for arn, state in rollout.robots.items()
            }
        }
    )
    before = len(json.dumps(bare.to_json()))
    started = time.perf_counter()
    read = Rollout.of_json(json.loads(stored))
    read_s = time.perf_counter() - started
    render_deployment(report_of(simulate(names[:1])))  # the template is compiled once
    cpu = time.process_time()
    page = render_deployment(report_of(read))
    page_s = time.process_time() - cpu

    assert "Wave 5" in page
    print(
        f"\nreport of {ROBOTS} robots: {page_s:.2f} CPU-s, {len(page) / 1e6:.2f} MB; rollout read in {read_s:.2f} s, "
        f"{len(stored) / 1e6:.1f} MB stored, {(len(stored) - before) / 1e6:.1f} MB of it times"
    )


@pytest.fixture
def yard(service: Service) -> list[str]:
    fleets = Fleets(service)
    fleet = fleets.fleet()
    return [fleets.robot(f"r{number}", fleet) for number in range(SEEN_AT_ONCE)]


@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_sightings_and_status(service: Service, yard: list[str]) -> None:
    started, cpu = time.perf_counter(), time.process_time()
    service.catalog.update_many({robot: RobotSighting(last_seen_s=1000.0) for robot in yard})
    many_s, many_cpu_s = time.perf_counter() - started, time.process_time() - cpu
    started = time.perf_counter()
    for robot in yard[:100]:
        service.catalog.update(robot, RobotSighting(last_seen_s=1001.0))
    single_s = (time.perf_counter() - started) * len(yard) / 100
    started = time.perf_counter()
    standing = fleet_standing(find_fleet("yard", service), service)
    status_s = time.perf_counter() - started

    assert len(standing.robots) == SEEN_AT_ONCE
    print(
        f"\n{SEEN_AT_ONCE} sightings in {many_s:.3f} s ({many_cpu_s:.3f} CPU-s), one by one {single_s:.2f} s; "
        f"status of so many robots in {status_s:.2f} s; load {os.getloadavg()[0]:.1f}"
    )
