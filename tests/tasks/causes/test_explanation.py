"""A run says why its trials failed, and claims no more than its trials show."""

import re
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from helpers.examples import examples
from helpers.planted_causes import draw, planted
from hypothesis import given
from hypothesis import strategies as st

from prefect_robomaker.schemas.reports.causes import Why
from prefect_robomaker.tasks.causes.explanation import explain
from prefect_robomaker.tasks.reporting.causes import why_in_lines
from prefect_robomaker.tasks.results.table import ResultTable

from .conftest import Row, missed, table_of

CAUSES = {each["id"]: each for each in planted("causes") if not each.get("held_back")}


def claims(why: Why | None) -> list[str]:
    return [claim.region for group in (why.groups if why else ()) for claim in group.claims]


def in_worlds(worlds: int, trials: int, fails: Callable[[int, float, np.random.Generator], bool]) -> list[Row]:
    """Trials of an axis from 0 to 1, in some worlds."""
    chance = np.random.default_rng(3)
    rows: list[Row] = []
    for world in range(worlds):
        for _ in range(trials):
            value = float(chance.random())
            outcome = "failed" if fails(world, value, chance) else "passed"
            rows.append({"world": world, "axes": {"noise": value}, "outcome": outcome})
    return rows


def test_no_failures_need_no_reason(made: Callable[..., Any]) -> None:
    assert explain(made([{"axes": {"noise": float(each)}} for each in range(50)])) is None
    assert explain(made([{"outcome": "broken"}, {"outcome": "passed"}])) is None


@pytest.mark.parametrize("name", ["kitchen-with-dropout", "fast-on-low-grip", "one-world-of-16"])
def test_a_planted_cause_heads_its_group(name: str) -> None:
    why = explain(draw(CAUSES[name], 1).table)
    assert why is not None
    [group] = [each for each in why.groups if each.claims]
    claim = group.claims[0]
    assert set(claim.axes) == set(CAUSES[name]["when"]) - {"world"}
    assert (group.requirement, group.room) == (CAUSES[name]["requirement"], CAUSES[name].get("room"))
    assert claim.low > 1
    assert claim.failed_inside + claim.failed_outside == group.failed
    assert group.command == f"robomaker repro {group.job} --trial {group.trial}"
    assert sum(each.failed for each in why.groups) == why.failed


def three_axes(fails: Callable[[int, int, int], bool]) -> Why | None:
    """Says why a grid of three axes and an innocent one fails, of which 2 % fail by chance, in 30 jobs."""
    chance = np.random.default_rng(5)
    cells = product((0, 1), repeat=4)
    rows: list[Row] = [
        {
            "job": f"sim-{job}",
            "seed": job,
            "trial": number,
            "axes": {"FLOOR": "ab"[floor], "light": float(light), "DOOR": "ab"[door], "noise": float(noise)},
            "outcome": "failed" if chance.random() < (0.8 if fails(floor, light, door) else 0.02) else "passed",
        }
        for number, (floor, light, door, noise) in enumerate(cells)
        for job in range(30)
    ]
    return explain(table_of(rows))


def test_three_axes_that_only_fail_together_are_one_claim() -> None:
    why = three_axes(lambda floor, light, door: bool(floor and light and door))
    assert why is not None
    [claim] = why.groups[0].claims
    assert (claim.kind, claim.axes) == ("triple", ["DOOR", "FLOOR", "light"])
    assert claim.region == "DOOR = b, FLOOR = b and light = 1"
    assert claim.low > 10
    [plot] = why.cell_plots
    assert (plot.axes, plot.group) == (["DOOR", "FLOOR"], "polite, where light = 1,")
    assert sum(cell.trials for cell in plot.cells) == 240, "the trials in the light"


@pytest.mark.parametrize(
    ("fails", "claimed"),
    [
        (lambda floor, light, _: floor and light, [["FLOOR", "light"]]),
        (
            lambda floor, light, door: floor + light + door >= 2,
            [["DOOR", "FLOOR"], ["DOOR", "light"], ["FLOOR", "light"]],
        ),
    ],
    ids=["two axes", "each two of three"],
)
def test_three_axes_are_not_claimed_where_two_suffice(
    fails: Callable[[int, int, int], bool], claimed: list[list[str]]
) -> None:
    why = three_axes(fails)
    assert why is not None
    found = [claim.axes for claim in why.groups[0].claims]
    assert sorted(found) == claimed


def test_an_axis_without_effect_makes_no_evidence_of_repeated_trials() -> None:
    """Trials fail by chance, and do so again with each value of an axis that changes states and no outcome."""
    for drawn in range(8):
        chance = np.random.default_rng(drawn)
        fails = chance.random((5, 4)) < 0.3
        rows: list[Row] = [
            {
                "axes": {"speed": speed, "idle": idle},
                "seed": seed,
                "outcome": "failed" if fails[speed, seed] else "passed",
            }
            for speed in range(5)
            for seed in range(4)
            for idle in range(10)
        ]
        assert claims(explain(table_of(rows))) == [], drawn


def test_the_order_of_rows_does_not_matter() -> None:
    table = draw(CAUSES["carpet"], 1).table
    arrow = table.to_arrow()
    mixed = arrow.take(pa.array(np.random.default_rng(1).permutation(arrow.num_rows)))
    one, other = explain(table), explain(ResultTable(mixed.column_names, mixed.num_rows, mixed.column))
    assert one is not None
    assert other is not None
    assert [(each.name, each.failed) for each in one.groups] == [(each.name, each.failed) for each in other.groups]
    assert claims(one) == claims(other) == ["FLOOR = carpet"]


def test_an_axis_that_goes_with_worlds_only_is_no_cause() -> None:
    """Noise is high in the four worlds that are hard; within a world it changes nothing."""

    def rows(spread: float) -> list[Row]:
        made = in_worlds(8, 60, lambda world, _, chance: chance.random() < (0.6 if world >= 4 else 0.05))
        for row in made:
            row["axes"] = {"noise": float(row["world"] >= 4) + spread * row["axes"]["noise"]}
        return made

    for spread in (0.0, 0.1):
        assert claims(explain(table_of(rows(spread)))) == []
    why = explain(table_of(rows(0.0)))
    assert why is not None
    assert "noise has the same value in all trials of each job" in why.refused[0]


def test_one_pair_of_trials_claims_nothing_however_many_values_an_idle_axis_has() -> None:
    rows = [
        {"axes": {"a": a, "idle": value}, "seed": 1, "outcome": "failed" if a else "passed", "state_digest": f"{a}"}
        for a in (0.0, 1.0)
        for value in map(float, range(20))
    ]
    why = explain(table_of(rows))
    assert why is not None
    assert claims(why) == []
    assert "axis idle changed nothing: trials that differ in it alone went through the same states" in why.refused[0]


def cells_of_jobs(fails: Callable[[int, int, int], bool], worlds: int = 1, seeds: int = 12) -> list[Row]:
    """Jobs without trials, one of each cell of two axes of their step, in each world and with each seed."""
    return [
        {
            "trial": None,
            "job": f"sim-{world}-{gain}-{load}-{seed}",
            "world": world,
            "seed": seed,
            "axes": {"gain": gain, "load": load, "place": f"content-{world}"},
            "outcome": "failed" if fails(gain, load, seed) else "passed",
        }
        for world in range(worlds)
        for gain in range(2)
        for load in range(2)
        for seed in range(seeds)
    ]


@pytest.mark.parametrize("worlds", [1, 8])
def test_an_axis_of_a_step_is_a_cause_among_jobs_without_trials(worlds: int) -> None:
    """Each cell is a job; jobs of the step in the same world are what it is compared with."""
    why = explain(table_of(cells_of_jobs(lambda gain, _, seed: gain == 1 and seed % 4 > 0, worlds)))
    assert why is not None
    [claim] = why.groups[0].claims
    assert (claim.region, claim.scope) == ("gain = 1", "such worlds" if worlds == 8 else "these worlds only")
    assert why.refused == []  # nor is the axis that is the world


def test_jobs_that_fail_by_chance_have_no_axis_as_their_cause() -> None:
    for drawn in range(8):
        chance = np.random.default_rng(drawn)
        hard = chance.random((2, 12)) < 0.3
        assert claims(explain(table_of(cells_of_jobs(lambda _, load, seed, hard=hard: bool(hard[load, seed]))))) == []


def trials_of_jobs(fails: Callable[[str, int], bool], seeds: int = 12) -> list[Row]:
    """Trials of two jobs of a step with an axis, of the same seeds in one world."""
    return [
        {
            "job": f"sim-{gain}", "seed": seed, "trial": seed, "axes": {"GAIN": gain},
            "outcome": "failed" if fails(gain, seed) else "passed", "state_digest": f"{gain} {seed}",
        }
        for gain in ("low", "high") for seed in range(seeds)
    ]  # fmt: skip


def test_an_axis_of_a_step_is_a_cause_among_trials_of_its_jobs() -> None:
    why = explain(table_of(trials_of_jobs(lambda gain, _: gain == "high")))
    assert why is not None
    assert [claim.region for group in why.groups for claim in group.claims] == ["GAIN = high"]
    assert why.refused == []


def test_an_axis_of_a_step_is_no_cause_of_trials_that_fail_by_their_seed() -> None:
    why = explain(table_of(trials_of_jobs(lambda _, seed: seed % 2 == 0, 40)))
    assert claims(why) == []


THINGS = ("chair", "table", "shelf", "sofa", "plant", "lamp")


def in_flats(share: Callable[[bool, str, str], float], seed: int, seeds: int = 3) -> list[Row]:
    """Jobs in five dense flats and five sparse ones, at two speeds, with and without a mat.

    They fail in several ways, and touch several things.

    Args:
        share: Chance to fail in a flat that is dense or not, at a speed, with or without a mat.
        seed: Of how they fail.
        seeds: Jobs of each cell.
    """
    chance = np.random.default_rng(seed)
    cells = product(range(10), ("slow", "fast"), ("mat", "bare"), range(seeds))
    rows: list[Row] = []
    for number, (world, speed, mat, own) in enumerate(cells):
        row: Row = {
            "job": f"sim-{number}", "trial": None, "seed": own, "world": world, "state_digest": str(number),
            "world_name": f"{'dense' if world < 5 else 'sparse'} flat {world % 5 + 1}",
            "axes": {"SPEED": speed, "MAT": mat},
        }  # fmt: skip
        if chance.random() < share(world < 5, speed, mat):
            touched = missed("gentle", other=f"{chance.choice(THINGS)} {number}", first_violation_s=5.0)
            row |= {"outcome": "failed", "requirements": [missed("to-bed") if chance.random() < 0.3 else touched]}
        rows.append(row)
    return rows


@pytest.mark.parametrize(
    ("share", "region"),
    [
        (lambda dense, speed, mat: 0.8 if speed == "fast" else 0.1, "with SPEED = fast"),
        (lambda dense, speed, mat: 0.75 if dense else 0.1, "in worlds of dense flat"),
        (lambda dense, speed, mat: 0.75 if mat == "bare" else 0.1, "with MAT = bare"),
    ],
    ids=["robot", "worlds", "mat"],
)
def test_a_cause_that_all_failures_share_is_said_of_all_first(
    share: Callable[[bool, str, str], float], region: str
) -> None:
    why = explain(table_of(in_flats(share, 3)))
    assert why is not None
    assert why.leading is why.overall
    assert why.overall is not None
    sentence = rf"{region}, (\d+) of \d+ jobs failed; elsewhere (\d+) of \d+ did: [\d.]+ times as often"
    told = re.match(sentence, why.headline)
    assert told is not None
    assert int(told[1]) + int(told[2]) == why.failed
    assert set(why.overall.breakdown) == {"missed first", "touched or too near"}
    assert sum(why.overall.breakdown["missed first"].values()) == why.failed
    assert [group.requirement for group in why.groups] == ["gentle", "to-bed"], "things are listed, not groups"
    for group in why.groups:
        assert group.claims or group.shared
    assert len(why_lines(why)) == 3


def why_lines(why: Why) -> list[str]:
    return list(why_in_lines(why))


def test_no_cause_is_named_where_jobs_fail_by_chance_and_how_many_would_tell_one_is_said_once() -> None:
    named = 0
    for seed in range(6):
        why = explain(table_of(in_flats(lambda *_: 0.4, seed)))
        assert why is not None
        assert claims(why) == []
        named += "may go with" in why.headline
        assert re.search(r"takes [\d,]+ jobs instead of 120", why.headline)
        lines = why_lines(why)
        assert sum("instead of" in line for line in lines) == 1, lines
    assert named <= 2


def test_two_causes_of_the_same_failures_are_both_in_the_headline() -> None:
    """Jobs fail in dense flats, and only where they are fast."""
    why = explain(table_of(in_flats(lambda dense, speed, _: 0.95 if dense and speed == "fast" else 0.02, 5)))
    assert why is not None
    assert "SPEED = fast" in why.headline
    assert "worlds of dense flat" in why.headline


def test_the_headline_says_how_to_run_more() -> None:
    table = table_of(in_flats(lambda *_: 0.4, 1))
    why = explain(table, again="robomaker run flats.yaml")
    assert why is not None
    assert why.headline.endswith("; then robomaker run flats.yaml")


def test_a_cause_of_one_way_to_fail_is_not_said_of_all_failures() -> None:
    rows = in_flats(lambda *_: 0.15, 2, seeds=6)
    for row in rows:
        if row.get("outcome") != "failed" and row["axes"]["SPEED"] == "fast" and row["seed"] % 2:
            row |= {"outcome": "failed", "requirements": [missed("calm")]}
    why = explain(table_of(rows))
    assert why is not None
    assert {group.requirement: bool(group.claims) for group in why.groups}["calm"]
    assert why.headline.startswith(f"with SPEED = fast, {why.groups[0].claims[0].failed_inside} of ")
    assert why.leading is None
    assert " jobs missed calm; elsewhere " in why.headline


def test_an_axis_that_no_world_varies_cannot_be_told_from_worlds() -> None:
    rows = [
        {"world": number % 6, "axes": {"gain": number % 2}, "outcome": ("passed", "failed")[number % 2]}
        for number in range(30)
    ]
    why = explain(table_of(rows))
    assert why is not None
    assert why.refused[0] == (
        "gain has the same value in all trials of each job, so that it cannot be told from the jobs' worlds; several "
        "values in each world would do"
    )


def test_what_broke_where_the_axis_is_high_is_no_failure_of_the_robot() -> None:
    rows = in_worlds(8, 50, lambda _, value, chance: value < 0.5 and chance.random() < 0.2)
    for row in rows:
        if row["axes"]["noise"] >= 0.5:
            row["outcome"] = "broken"
    why = explain(table_of(rows))
    assert why is not None
    assert why.trials == sum(row["outcome"] != "broken" for row in rows)
    assert claims(why) == []


def test_failures_that_hide_others_do_not_make_the_rest_gather_elsewhere(miss: Callable[..., dict[str, Any]]) -> None:
    """Above 0.5 most trials fail at once; what fails by chance later is seen below 0.5 only."""
    chance = np.random.default_rng(9)
    rows = in_worlds(10, 100, lambda *_: False)
    for row in rows:
        if row["axes"]["noise"] > 0.5 and chance.random() < 0.9:
            row |= {"outcome": "failed", "requirements": [miss("polite")]}
        elif chance.random() < 0.15:
            row |= {"outcome": "failed", "requirements": [miss("upright")]}
    why = explain(table_of(rows))
    assert why is not None
    assert {group.requirement: bool(group.claims) for group in why.groups} == {"polite": True, "upright": False}


def test_axes_that_vary_together_are_named_together() -> None:
    rows = in_worlds(8, 60, lambda _, value, chance: chance.random() < (0.5 if value > 0.6 else 0.03))
    for row in rows:
        row["axes"]["latency"] = row["axes"]["noise"] / 10
    why = explain(table_of(rows))
    assert why is not None
    claim = why.groups[0].claims[0]
    assert len(claim.alike) == 1
    assert "has nearly the same trials" in claim.numbers


def test_few_worlds_speak_for_themselves_only() -> None:
    def fails(_: int, value: float, chance: np.random.Generator) -> bool:
        return chance.random() < (0.6 if value > 0.6 else 0.03)

    def scopes(worlds: int) -> set[str]:
        why = explain(table_of(in_worlds(worlds, 80, fails)))
        return {claim.scope for group in (why.groups if why else ()) for claim in group.claims}

    assert scopes(3) == {"these worlds only"}
    assert scopes(8) == {"such worlds"}


def test_an_axis_that_matters_in_one_world_alone_does_not_hold_for_such_worlds() -> None:
    def fails(world: int, value: float, chance: np.random.Generator) -> bool:
        return chance.random() < (0.9 if world == 0 and value > 0.5 else 0.03)

    why = explain(table_of(in_worlds(8, 60, fails)))
    assert not [claim for group in (why.groups if why else ()) for claim in group.claims if claim.kind == "axis"]


def test_too_few_failures_are_refused_with_what_would_do() -> None:
    rows = in_worlds(6, 10, lambda *_: False)
    for row in rows[:4]:
        row["outcome"] = "failed"
    why = explain(table_of(rows))
    assert why is not None
    assert why.groups[0].refused == (
        "a claim takes 10 failures, and there are 4; at this rate that takes 150 trials instead of 60, such as 25 "
        "points instead of 10"
    )
    assert why.groups[0].in_words == f"polite: 4 trials missed it first; {why.groups[0].refused}"
    slip = [{"axes": {"slip": 0.6 * (number % 2)}, "seed": number // 2} for number in range(16)]
    split = explain(table_of([{**row, "outcome": ("passed", "failed")[number % 2]} for number, row in enumerate(slip)]))
    assert split is not None
    assert split.groups[0].refused == (
        "all 8 have slip = 0.6 (8 of 8, elsewhere 0 of 8); too few to claim: that takes 10 failures, and there are "
        "8; to tell so large an effect takes 20 trials instead of 16, such as 10 seeds instead of 8"
    )


def two_stops(hides: str = "", gentle_is_judged: bool = True) -> list[Row]:
    """Trials of a robot that is too slow where it stops far off, and not gentle where it stops near, so none passes.

    Args:
        hides: `latter`: far off, half of the trials miss `gentle` as well, later; `end`: they end at once.
        gentle_is_judged: Whether `gentle` was judged far off.
    """
    rows: list[Row] = []
    for number in range(64):
        is_near, seed = number % 2 == 0, number // 2
        is_rough = is_near or (hides == "latter" and seed % 2 == 0)
        rough_s = {"first_violation_s": 10.0 if is_near else 25.0, "room": "Living"} if is_rough else {}
        slow_s = {} if is_near else {"first_violation_s": 0.5 if hides == "end" else 20.0}
        asked: list[dict[str, Any]] = [{"name": "quick", "satisfied": is_near, "detail": "", **slow_s}]
        if is_near or gentle_is_judged:
            asked.append({"name": "gentle", "satisfied": not is_rough, "detail": "", **rough_s})
        rows.append(
            {
                "axes": {"STOP": "near" if is_near else "far"},
                "seed": seed,
                "state_digest": str(number),
                "outcome": "failed",
                "requirements": asked,
                "end_s": 0.5 if hides == "end" and not is_near else 30.0,
            }
        )
    return rows


def test_where_no_trial_passed_those_that_failed_otherwise_are_compared() -> None:
    why = explain(table_of(two_stops()))
    assert why is not None
    said = {each.requirement: each.in_words for each in why.groups}
    assert said["gentle"].startswith(
        "gentle, in Living: 32 trials missed it first; STOP = near: all 32 failed; elsewhere none of 32 did, in "
    )
    assert said["quick"].startswith("quick: 32 trials missed it first; STOP = far: all 32 failed; elsewhere none of ")
    assert said["quick"].endswith("; 32 that failed otherwise are compared, too, as nearly none passed")


def test_a_requirement_missed_later_counts_as_missed_where_no_trial_passed() -> None:
    why = explain(table_of(two_stops(hides="latter")))
    assert why is not None
    [gentle] = [each for each in why.groups if each.requirement == "gentle"]
    [claim] = gentle.claims
    assert (claim.failed_inside, claim.failed_outside, claim.trials_outside) == (32, 16, 32)
    assert gentle.cause.startswith("with STOP = near, all 32 trials missed gentle; elsewhere 16 of 32 did: ")


@pytest.mark.parametrize("rows", [two_stops(gentle_is_judged=False), two_stops(hides="end")], ids=["no", "too short"])
def test_a_trial_that_could_not_fail_so_is_no_comparison(rows: list[Row]) -> None:
    why = explain(table_of(rows))
    assert why is not None
    [gentle] = [each for each in why.groups if each.requirement == "gentle"]
    assert (gentle.claims, gentle.nothing) == (
        [],
        "no trial passed, so there is nothing to compare with (32 failed otherwise, perhaps before they could have "
        "failed so)",
    )


def test_a_trial_that_the_duration_limit_ended_was_not_cut_short_by_what_it_missed() -> None:
    """A goal that is not reached is found missed at the end, also where the limit ended the trial."""
    rows = two_stops(hides="end")
    for row in rows:
        if row["axes"]["STOP"] == "far":
            row |= {"ended_by": "duration limit"}
    why = explain(table_of(rows))
    assert why is not None
    [gentle] = [each for each in why.groups if each.requirement == "gentle"]
    assert gentle.in_words.startswith(
        "gentle, in Living: 32 trials missed it first; STOP = near: all 32 failed; elsewhere none of 32 did, in "
    )


def test_a_value_whose_trials_all_failed_otherwise_rules_nothing_out() -> None:
    """Half of the near trials pass, and none of the far ones, so that `gentle` cannot be compared there."""
    rows = two_stops(gentle_is_judged=False)
    for row in rows:
        if row["axes"]["STOP"] == "near" and row["seed"] % 2:
            row |= {"outcome": "passed"}
    why = explain(table_of(rows))
    assert why is not None
    [gentle] = [each for each in why.groups if each.requirement == "gentle"]
    assert gentle.nothing == (
        "too few trials to tell: all 32 trials with STOP = far failed otherwise, so there is nothing to compare with"
    )


def test_a_failure_that_hides_another_is_no_cause_of_it_where_nearly_no_trial_passed() -> None:
    """Most far trials are slow before they could be rough; how rough trials are depends on chance alone."""
    claimed = 0
    for drawn in range(12):
        chance = np.random.default_rng(drawn)
        rows: list[Row] = []
        for number in range(240):
            stop = ("near", "far")[number % 2]
            slow, rough = bool(chance.random() < {"near": 0.8, "far": 0.98}[stop]), bool(chance.random() < 0.6)
            asked = [
                {"name": "quick", "satisfied": not slow, "detail": "", **({"first_violation_s": 5.0} if slow else {})},
                {
                    "name": "gentle",
                    "satisfied": not rough,
                    "detail": "",
                    **({"first_violation_s": 9.0} if rough else {}),
                },
            ]
            outcome = "failed" if slow or rough else "passed"
            row: Row = {"axes": {"STOP": stop}, "seed": number // 2, "state_digest": str(number), "end_s": 30.0}
            rows.append(row | {"outcome": outcome, "requirements": asked})
        why = explain(table_of(rows))
        claimed += any(each.claims for each in (why.groups if why else ()) if each.requirement == "gentle")
    assert claimed <= 3, "0.6 would be expected of 5 %"


def test_jobs_without_trials_count_as_trials_beside_jobs_with_some() -> None:
    jobs: list[Row] = [{"job": f"sim-{each}", "trial": None, "outcome": "failed", "world": each} for each in range(3)]
    of_trials: list[Row] = [{"job": "sim-3", "outcome": "failed" if each < 10 else "passed"} for each in range(50)]
    mixed, alone = explain(table_of([*jobs, *of_trials])), explain(table_of(jobs))
    assert mixed is not None
    assert alone is not None
    said = [(why.size, why.groups[0].size) for why in (mixed, alone)]
    assert said == [
        ("13 of 53 trials failed", "polite: 13 trials missed it first"),
        ("3 of 3 jobs failed", "polite: 3 jobs missed it first"),
    ]


def test_many_trials_tell_that_no_axis_is_the_cause() -> None:
    why = explain(table_of(in_worlds(8, 100, lambda _, __, chance: chance.random() < 0.5)))
    assert why is not None
    assert why.groups[0].nothing == "no axis and no world explains it"


def test_without_axes_and_with_few_worlds_nothing_can_be_claimed(made: Callable[..., Any]) -> None:
    why = explain(made([{"outcome": "failed" if each < 20 else "passed"} for each in range(40)]))
    assert why is not None
    assert (why.refused, claims(why)) == ([], []), "they were not to find a cause"
    rows = in_worlds(3, 10, lambda _, __, chance: chance.random() < 0.5)
    why = explain(made([{**row, "axes": {}} for row in rows]))
    assert why is not None
    assert why.refused == [
        "3 worlds are too few to look for what the failures have in common; 6 of them, or axes, would do"
    ]


def test_an_example_is_one_that_was_recorded(made: Callable[..., Any]) -> None:
    rows = [{"outcome": "failed"}, {"outcome": "failed", "output": "file:///out/trials/000001"}, {}]
    why = explain(made(rows))
    assert why is not None
    assert (why.groups[0].trial, why.groups[0].clip) == (1, "file:///out/trials/000001")


values = st.one_of(st.none(), st.sampled_from([0.0, 0.5, 1.0, 2.5]))
trials = st.fixed_dictionaries(
    {
        "world": st.integers(0, 7),
        "seed": st.integers(0, 2),
        "outcome": st.sampled_from(["passed", "failed", "broken", "canceled", "no verdict"]),
        "axes": st.fixed_dictionaries({"a": values, "b": values, "KIND": st.sampled_from([None, "x", "y"])}),
        "margin": st.one_of(st.none(), st.floats(-1, 1)),
    }
)


@examples(60)
@given(st.lists(trials, max_size=40))
def test_any_table_has_an_answer(rows: Sequence[Row]) -> None:
    why = explain(table_of(rows)) if rows else None
    failed = sum(row["outcome"] == "failed" for row in rows)
    if not failed:
        assert why is None
        return
    assert why is not None
    assert sum(group.failed for group in why.groups) == why.failed == failed
    assert why.trials == sum(row["outcome"] in ("passed", "failed") for row in rows)
    for group in why.groups:
        for claim in group.claims:
            assert claim.low <= claim.lift <= claim.high
