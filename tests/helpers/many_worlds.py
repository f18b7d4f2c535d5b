"""Making and proving many worlds of templates drawn at random, kept unfiltered, with several processes.

`tests/endurance/many_worlds.py` runs it.
"""

import argparse
import json
import multiprocessing
import os
import platform
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from helpers.random_templates import random_template
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.schemas.wire.errors import WorldGenerationError
from prefect_robomaker.schemas.worlds.world import StabilityChecks, World, WorldChecks
from prefect_robomaker.tasks.worldforge.furniture.usual_furniture import INDISPENSABLE
from prefect_robomaker.tasks.worldforge.generator import GENERATOR_VERSION, generate_world, seeds_for
from prefect_robomaker.tasks.worldforge.model.mjcf import world_mjcf
from prefect_robomaker.tasks.worldforge.proofs.guarantees import (
    MAX_DRIFT_M,
    MAX_MOVED_M,
    MAX_PENETRATION_M,
    MAX_SUNK_M,
    MIN_CELLS,
)
from prefect_robomaker.tasks.worldforge.proofs.overlaps import measure_stability

MOST_FAILURES = 0.001
MOST_TOLD = 20
OUTCOMES = ("satisfied", "missed", "contradictory")
SLICE = 5
"""Worlds that a process makes before it takes the next ones: of one template, whose plans are searched for once."""

Slice = tuple[int, range, int, int, bool]
"""A template, the worlds of it, how many of its first ones are pushed, the seed, and whether it has balconies."""


@dataclass
class Tally:
    """What was found in some of the worlds."""

    worlds: int = 0
    failures: list[str] = field(default_factory=list)
    other_errors: list[str] = field(default_factory=list)
    second_interiors: int = 0
    overlapping: list[str] = field(default_factory=list)
    deepest_overlap_m: float = 0.0
    moving: list[str] = field(default_factory=list)
    furthest_move_m: float = 0.0
    free_bodies: int = 0
    rooms: int = 0
    unreached: list[str] = field(default_factory=list)
    reached_shares: list[float] = field(default_factory=list)
    lacking: list[str] = field(default_factory=list)
    pushed: int = 0
    pushed_away: list[str] = field(default_factory=list)
    furthest_pushed_m: float = 0.0
    wishes: Counter[str] = field(default_factory=Counter)
    cpu_s: float = 0.0

    def add(self, other: "Tally") -> None:
        """Takes in what was found in other worlds."""
        for name, value in vars(other).items():
            mine = getattr(self, name)
            setattr(self, name, max(mine, value) if name.endswith("_m") else mine + value)

    def measure(self, name: str, checks: WorldChecks) -> None:
        """Takes in the proofs of a world."""
        self.deepest_overlap_m = max(self.deepest_overlap_m, checks.max_penetration_m)
        if checks.max_penetration_m > MAX_PENETRATION_M:
            self.overlapping.append(f"{name}: {checks.penetrating} by {checks.max_penetration_m} m")
        moved = checks.max_drift_m or 0.0
        self.furthest_move_m = max(self.furthest_move_m, moved)
        if checks.settled_share != 1.0 or moved >= MAX_DRIFT_M:
            self.moving.append(f"{name}: {moved} m")
        self.free_bodies += checks.free_bodies
        self.rooms += len(checks.reachable_cells)
        for room, cells in checks.reachable_cells.items():
            if cells < MIN_CELLS or room in checks.unreachable_goals:
                self.unreached.append(f"{name}: {room}")
        self.reached_shares.append(checks.reachable_share)

    def push(self, name: str, stability: StabilityChecks) -> None:
        """Takes in what became of a world that was pushed."""
        self.pushed += 1
        self.furthest_pushed_m = max(self.furthest_pushed_m, stability.max_moved_m)
        if stability.max_moved_m > MAX_MOVED_M or stability.max_sunk_m > MAX_SUNK_M:
            self.pushed_away.append(f"{name}: {stability.furthest} by {stability.max_moved_m} m")


def worlds_of(work: Slice) -> Tally:
    """Makes and proves the worlds of a slice."""
    template, indices, pushed, seed, balconies = work
    tally, begun = Tally(), time.process_time()
    body = random_template(seed + template, balconies=balconies)
    for index in indices:
        name = f"template {seed + template}, world {index}"
        tally.worlds += 1
        try:
            world = made(body, seed + template, index)
            take_in(tally, name, world, pushed=index < pushed)
            tally.lacking += [f"{name}: {room}" for room in lacking(body, world)]
        except WorldGenerationError as error:
            tally.failures.append(f"{name}: {error}")
        except Exception as error:  # one world's error is told, and the others are made
            tally.other_errors.append(f"{name}: {type(error).__name__}: {error}")
    tally.cpu_s = time.process_time() - begun
    return tally


def made(body: WorldTemplateBody, template: int, index: int) -> World:
    """A proven world."""
    return generate_world(body, *seeds_for(template, index, 0))


def lacking(body: WorldTemplateBody, world: World) -> list[str]:
    """Rooms whose furniture was left open and that are not what they are called: kitchens without an oven."""
    sets = [one for one in body.interior.Furniture.FurnitureArrangements if one.SampleSet is not None]
    listed = {name for one in sets for name in getattr(one.TargetSet, "RoomNames", None) or ()}
    found: list[str] = []
    for room in world.floorplan.rooms:
        needed = INDISPENSABLE.get(room.type, ())
        kinds = {piece.model_type for piece in world.furniture if piece.room == room.name}
        if needed and room.name not in listed and kinds.isdisjoint(needed):
            found.append(room.name)
    return found


def take_in(tally: Tally, name: str, world: World, *, pushed: bool) -> None:
    """Takes in what a world's proofs say."""
    assert world.checks is not None
    tally.measure(name, world.checks)
    tally.second_interiors += world.interior_attempt > 0
    for wish in (*world.floorplan.wishes, *world.wishes):
        kind = wish.path.rpartition(".")[2].partition("[")[0]
        tally.wishes[f"{'Footprint' if 'Footprint' in wish.path else kind} {wish.outcome}"] += 1
    if pushed:
        model = mujoco.MjModel.from_xml_string(world_mjcf(world))
        tally.push(name, measure_stability(model, world.interior_seed))


def slices(args: argparse.Namespace) -> Iterator[Slice]:
    """All work, first worlds first, so that a run that is cut short has seen every template."""
    for start in range(args.first, args.first + args.worlds, SLICE):
        for template in range(args.templates):
            share = args.pushed // args.templates + (template < args.pushed % args.templates)
            yield template, range(start, min(start + SLICE, args.first + args.worlds)), share, args.seed, args.balconies


def summary(tally: Tally, args: argparse.Namespace, wall_s: float) -> dict[str, Any]:
    """The figures, and whether targets are met."""
    proven = max(1, tally.worlds - len(tally.failures) - len(tally.other_errors))
    failed = len(tally.failures) + len(tally.other_errors)
    wishes = {
        kind: round(tally.wishes[f"{kind} satisfied"] / sum(tally.wishes[f"{kind} {how}"] for how in OUTCOMES), 4)
        for kind in sorted({key.rpartition(" ")[0] for key in tally.wishes})
    }
    return {
        "targets_met": {
            "overlaps": not tally.overlapping,
            "movers": not tally.moving,
            "rooms_reached": not tally.unreached,
            "pushed": not tally.pushed_away,
            "indispensable": not tally.lacking,
            "failures": failed <= MOST_FAILURES * tally.worlds,
        },
        "complete": tally.worlds == args.templates * args.worlds,
        "templates": args.templates,
        "worlds": tally.worlds,
        "failures": failed,
        "failed": (tally.failures + tally.other_errors)[:MOST_TOLD],
        "worlds_that_needed_another_interior": tally.second_interiors,
        "worlds_with_overlaps": len(tally.overlapping),
        "overlapping": tally.overlapping[:MOST_TOLD],
        "deepest_overlap_mm": round(1e3 * tally.deepest_overlap_m, 3),
        "worlds_with_movers": len(tally.moving),
        "moving": tally.moving[:MOST_TOLD],
        "furthest_move_mm": round(1e3 * tally.furthest_move_m, 3),
        "free_bodies": tally.free_bodies,
        "rooms": tally.rooms,
        "rooms_not_reached": len(tally.unreached),
        "unreached": tally.unreached[:MOST_TOLD],
        "least_share_of_free_floor_reached": min(tally.reached_shares, default=None),
        "mean_share_of_free_floor_reached": round(sum(tally.reached_shares) / proven, 5),
        "rooms_that_lack_the_indispensable": len(tally.lacking),
        "lacking": tally.lacking[:MOST_TOLD],
        "worlds_pushed": tally.pushed,
        "worlds_pushed_away": len(tally.pushed_away),
        "pushed_away": tally.pushed_away[:MOST_TOLD],
        "furthest_pushed_mm": round(1e3 * tally.furthest_pushed_m, 3),
        "share_of_wishes_satisfied": wishes,
        "seed": args.seed,
        "first": args.first,
        "balconies": args.balconies,
        "commit": args.commit,
        "generator": GENERATOR_VERSION,
        "versions": {"python": platform.python_version(), "mujoco": mujoco.__version__, "numpy": np.__version__},
        "processes": args.processes,
        "wall_s": round(wall_s, 1),
        "cpu_s": round(tally.cpu_s, 1),
        "cpu_ms_a_world": round(1e3 * tally.cpu_s / max(1, tally.worlds), 1),
    }


def commit() -> str:
    """The checkout's commit, or nothing where git does not know it."""
    words = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12"]
    try:
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def arguments() -> argparse.Namespace:
    """What is asked for."""
    parser = argparse.ArgumentParser(description="Makes and proves many worlds of random templates.")
    parser.add_argument("--templates", type=int, default=100, help="how many templates (100)")
    parser.add_argument("--worlds", type=int, default=100, help="worlds of each template (100)")
    parser.add_argument("--pushed", type=int, default=100, help="worlds in all that are pushed 8 times for 30 s (100)")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="processes (all cores)")
    parser.add_argument("--seed", type=int, default=0, help="number of the first template (0)")
    parser.add_argument("--first", type=int, default=0, help="number of each template's first world (0)")
    parser.add_argument("--balconies", action="store_true", help="gives each template one or two balconies")
    parser.add_argument("--limit-s", type=float, default=float("inf"), help="seconds after which no more is begun")
    parser.add_argument("--commit", default="", help="the commit to name in the summary")
    args = parser.parse_args()
    args.commit = args.commit or commit()  # before anything, since a run is long and checkouts change
    return args


def main() -> int:
    """Makes the worlds and prints the summary."""
    args, begun, tally = arguments(), time.monotonic(), Tally()
    with multiprocessing.get_context("spawn").Pool(args.processes) as pool:
        for number, found in enumerate(pool.imap_unordered(worlds_of, slices(args)), start=1):
            tally.add(found)
            if number % 50 == 0:
                failed = len(tally.failures) + len(tally.other_errors)
                told = f"{tally.worlds} worlds, {failed} failed, {time.monotonic() - begun:.0f} s"
                print(told, file=sys.stderr, flush=True)
            if time.monotonic() - begun > args.limit_s:
                break
        pool.terminate()
    figures = summary(tally, args, time.monotonic() - begun)
    print(json.dumps(figures, indent=1))
    return 0 if figures["complete"] and all(figures["targets_met"].values()) else 1
