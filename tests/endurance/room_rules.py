"""Counts the places of 200 furnished worlds that an architect would not sign, and prints one JSON summary.

```sh
python tests/endurance/room_rules.py --seeds 40 --processes 2
```

Worlds are those of five templates. Generator 3.3.1 breaks rules in 2 places.
Ends with 1 when more than five places break a rule, or a proof of a world fails.
"""

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections import Counter
from typing import Any

import many_worlds  # noqa: F401 (finds the package in a checkout)
from helpers.room_rules import RULES, TEMPLATES, Case, broken, few_forms, is_fine, kitchens_of, same_pieces

from prefect_robomaker.schemas.wire.errors import WorldGenerationError
from prefect_robomaker.tasks.worldforge.generator import GENERATOR_VERSION, generate_world, seeds_for

JOB_SEED = 7
MOST_BROKEN = 5
MOST_TOLD = 12


def looked_at(work: tuple[str, int]) -> tuple[dict[str, list[str]], list[tuple[str, tuple[str, ...]]], float]:
    """Broken rules of a world, its kitchens, and CPU seconds that it took."""
    name, number = work
    begun = time.process_time()
    try:
        world = generate_world(TEMPLATES[name], *seeds_for(JOB_SEED, number, 0), settle="loose" in name)
    except WorldGenerationError as error:
        return {"proofs": [f"{name}, plan {number}: {error}"]}, [], time.process_time() - begun
    took_s = time.process_time() - begun
    case = Case(TEMPLATES[name], world)
    found = {rule: [f"{name}, plan {number}: {each}" for each in places] for rule, places in broken(case).items()}
    return found, list(kitchens_of(case)), took_s


def main() -> int:
    """Makes the worlds and prints the summary."""
    parser = argparse.ArgumentParser(description="Counts broken rules of interiors.")
    parser.add_argument("--seeds", type=int, default=40, help="worlds of each template, of different plans (40)")
    parser.add_argument("--first", type=int, default=0, help="number of the first plan (0)")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="processes (all cores)")
    parser.add_argument("--told", type=int, default=MOST_TOLD, help="places that are told of each rule (12)")
    args = parser.parse_args()
    found: dict[str, list[str]] = {name: [] for name in (*RULES, "proofs")}
    forms: Counter[str] = Counter()
    pieces: Counter[tuple[str, ...]] = Counter()
    cpu_s = 0.0
    work = [(name, number) for name in TEMPLATES for number in range(args.first, args.first + args.seeds)]
    with multiprocessing.get_context("spawn").Pool(args.processes) as pool:
        for places, kitchens, took_s in pool.imap(looked_at, work, chunksize=5):
            cpu_s += took_s
            for name, each in places.items():
                found[name] += each
            forms.update(form for form, _ in kitchens)
            pieces.update(made for _, made in kitchens)
    found["kitchens"] += [*few_forms(forms), *same_pieces(pieces)]
    total = sum(map(len, found.values()))
    figures: dict[str, Any] = {
        "generator": GENERATOR_VERSION,
        "worlds": len(work),
        "broken": total,
        "by_rule": {name: len(places) for name, places in found.items()},
        "kitchens": dict(forms.most_common()),
        "different_kitchens": len(pieces),
        "cpu_ms_a_world": round(1e3 * cpu_s / len(work), 1),
        "places": {name: places[: args.told] for name, places in found.items() if places},
    }
    print(json.dumps(figures, indent=1))
    return 0 if is_fine(found, MOST_BROKEN) else 1


if __name__ == "__main__":
    sys.exit(main())
