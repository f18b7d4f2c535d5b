"""Tables of results with or without a planted cause of failures, as `endurance/planted_causes.yaml` says."""

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from ruamel.yaml import YAML
from scipy.special import expit, logit, ndtri
from scipy.stats import qmc

from helpers.paths import REPOSITORY
from prefect_robomaker.tasks.results.table import ResultTable

REQUIREMENTS = {"polite": "no_collision", "upright": "upright", "to-bed": "goal"}
ROOMS = ("Kitchen", "Hallway", "Living", "Bedroom")
THINGS = ("chair", "wall", "table", "person")
PHASES = ("before to-kitchen", "after to-kitchen")
KITCHEN_S, END_S = 20.0, 60.0


@dataclass(frozen=True)
class Drawn:
    """A drawn table of results, and the trials that the cause could make fail."""

    table: ResultTable
    region: NDArray[np.bool_]


def planted(part: str) -> list[dict[str, Any]]:
    """Reads the entries of a part of the file: `causes`, or `nothing`."""
    with (REPOSITORY / "tests/endurance/planted_causes.yaml").open() as file:
        return [dict(each) for each in YAML(typ="safe").load(file)[part]]


def draw(entry: Mapping[str, Any], seed: int) -> Drawn:
    """Draws the trials of an entry of the file, and how they ended."""
    chance = np.random.default_rng(seed)
    worlds, trials = int(entry["worlds"]), int(entry["seeds"])
    same = _points(entry, chance)
    points = [same if entry["points"] == "same" else _points(entry, chance) for _ in range(worlds)]
    hard = chance.normal(0, entry["world_spread"], worlds)
    if "confounded" in entry:
        points = _confounded(entry, points, hard, chance)
    cells = len(points[0]["@"])
    world = np.repeat(np.arange(worlds), cells * trials)
    seeds = np.tile(np.tile(np.arange(trials), cells), worlds)
    axes = {
        name: np.concatenate([np.repeat(each[name], trials) for each in points]) for name in points[0] if name != "@"
    }
    of_seeds = chance.normal(0, entry["seed_spread"], (worlds, trials))[world, seeds]
    level = logit(entry["base"]) + hard[world] + of_seeds
    if "suits" in entry:
        first = next(iter(axes))
        slope = chance.normal(0, entry["suits"], worlds)
        level = level + slope[world] * np.sqrt(12) * (axes[first] / axes[first].max() - 0.5)
    region = _region(entry.get("when"), axes, world)
    by_chance = chance.random(len(world)) < expit(level)
    if "repeats" in entry:
        by_chance = by_chance[_firsts([world, seeds, *(axes[name] for name in axes if name != entry["repeats"])])]
    by_cause = region & (chance.random(len(world)) < expit(logit(entry.get("chance", 0.5)) + hard[world] / 2))
    rows = [
        _row(entry, chance, int(world[row]), int(seeds[row]), bool(by_chance[row]), bool(by_cause[row]), row)
        for row in range(len(world))
    ]
    columns = {name: [each[name] for each in rows] for name in rows[0]}
    columns |= {f"axis.{name}": values.tolist() for name, values in axes.items()}
    table = pa.table(columns)
    return Drawn(ResultTable(table.column_names, table.num_rows, table.column), region)


def _points(entry: Mapping[str, Any], chance: np.random.Generator) -> dict[str, NDArray[Any]]:
    """Values of each axis in each cell; `@` numbers the cells."""
    axes, design = entry["axes"], entry["design"]
    if design == "grid":
        listed = [each["values"] if isinstance(each, dict) else each for each in axes.values()]
        cells = list(product(*listed))
        found = {name: np.array([cell[place] for cell in cells]) for place, name in enumerate(axes)}
        return found | {"@": np.arange(len(cells))}
    count = int(entry["count"])
    engines = {"sobol": qmc.Sobol, "latin-hypercube": qmc.LatinHypercube}
    if design == "random":
        unit = chance.random((count, len(axes)))
    else:
        with warnings.catch_warnings():  # numbers that are no powers of two are balanced less well
            warnings.simplefilter("ignore", UserWarning)
            unit = engines[design](len(axes), seed=chance).random(count)
    found: dict[str, NDArray[Any]] = {}
    for place, (name, values) in enumerate(axes.items()):
        share = unit[:, place]
        if all(isinstance(each, int | float) for each in values):
            found[name] = values[0] + share * (values[1] - values[0])
        else:
            found[name] = np.array(values)[np.minimum((share * len(values)).astype(int), len(values) - 1)]
    return found | {"@": np.arange(count)}


def _confounded(
    entry: Mapping[str, Any], points: list[dict[str, Any]], hard: NDArray[np.float64], chance: np.random.Generator
) -> list[dict[str, Any]]:
    """Gives nine in ten trials of a world the value that goes with how hard the world is."""
    place = np.argsort(np.argsort(hard)) / max(1, len(hard) - 1)
    made = []
    for world, own in enumerate(points):
        new = dict(own)
        for name in entry["confounded"]:
            values = entry["axes"][name]
            is_number = all(isinstance(each, int | float) for each in values)
            all_same = (
                values[0] + place[world] * (values[1] - values[0])
                if is_number
                else values[round(place[world] * (len(values) - 1))]
            )
            new[name] = np.where(chance.random(len(own["@"])) < 0.9, all_same, own[name])
        made.append(new)
    return made


def _firsts(columns: list[NDArray[Any]]) -> NDArray[np.int_]:
    """Returns for each row the first one with the same values."""
    codes = np.stack([np.unique(each, return_inverse=True)[1] for each in columns])
    _, first, numbers = np.unique(codes, axis=1, return_index=True, return_inverse=True)
    return first[numbers.ravel()]


def _region(when: Mapping[str, Any] | None, axes: Mapping[str, NDArray[Any]], world: NDArray[np.int_]) -> Any:
    if when is None:
        return np.zeros(len(world), dtype=bool)
    region = np.ones(len(world), dtype=bool)
    for name, rule in when.items():
        if name == "world":
            region &= world == rule
        elif "is" in rule:
            region &= axes[name] == rule["is"]
        else:
            region &= axes[name] > rule.get("above", -np.inf)
            region &= axes[name] < rule.get("below", np.inf)
    return region


def _row(
    entry: Mapping[str, Any],
    chance: np.random.Generator,
    world: int,
    seed: int,
    by_chance: bool,
    by_cause: bool,
    row: int,
) -> dict[str, Any]:
    """One trial; the cause's requirement, room, thing and phase are those of the entry, others are drawn."""
    missed = {
        "requirement": str(chance.choice(list(REQUIREMENTS))),
        "room": str(chance.choice(ROOMS)),
        "other": str(chance.choice(THINGS)),
        "phase": str(chance.choice(PHASES)),
    }
    if by_cause:
        missed |= {name: str(entry[name]) for name in missed if name in entry}
    has_failed = by_chance or by_cause
    time_s = chance.uniform(*((1, KITCHEN_S) if missed["phase"] == PHASES[0] else (KITCHEN_S, END_S)))
    requirements: list[dict[str, Any]] = [
        {"name": "to-kitchen", "kind": "goal", "satisfied": True, "detail": "", "value": KITCHEN_S, "unit": "s"}
    ]
    margins = {}
    for name, kind in REQUIREMENTS.items():
        is_missed = has_failed and name == missed["requirement"]
        margin = float(ndtri(chance.uniform(0.01, 0.99)) * 0.1 + 0.5) * (-1 if is_missed else 1)
        one: dict[str, Any] = {"name": name, "kind": kind, "satisfied": not is_missed, "detail": "", "unit": "m"}
        one["margin"] = margins[name] = margin
        if is_missed:
            one |= {"first_violation_s": time_s, "room": missed["room"]}
            one |= {"other": f"{missed['other']}_{chance.integers(1, 9)}"} if kind == "no_collision" else {}
        requirements.append(one)
    is_met = {name: not (has_failed and name == missed["requirement"]) for name in REQUIREMENTS}
    return {
        "step": "drive",
        "test": f"world-{world}",
        "job": f"sim-{world}-{row}" if entry.get("jobs") else f"sim-{world}",
        "world": f"content-{world}",
        "world_name": f"world-{world}",
        "outcome": "failed" if has_failed else "passed",
        "output": None,
        "state_digest": None,
        "trial": None if entry.get("jobs") else row,
        "seed": seed,
        "verdict": "FAIL" if has_failed else "PASS",
        "sim_time_s": END_S,
        **{f"requirement.{name}": each for name, each in is_met.items()},
        **{f"margin.{name}": each for name, each in margins.items()},
        "requirements": json.dumps(requirements),
    }


def trials_where(region: str, table: ResultTable) -> NDArray[np.bool_]:
    """Returns which trials lie in a region in words, such as `noise ≥ 0.02 and FLOOR = carpet`."""
    mask = np.ones(len(table), dtype=bool)
    for part in region.split(" and "):
        name, sign, limit = part.split(" ", 2)
        values = np.array(table.values(name))
        if sign == "=":
            mask &= np.isclose(values, float(limit)) if values.dtype.kind in "fi" else values.astype(str) == limit
        else:
            mask &= values >= float(limit) if sign == "≥" else values < float(limit)
    return mask
