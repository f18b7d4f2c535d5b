"""Choice of plans and their order: different ones first, none worse than it may be."""

from collections.abc import Iterator
from math import log
from random import Random
from unittest.mock import patch

import numpy as np
import pytest
from helpers.many_plans import PlanCount
from helpers.plan_templates import TEMPLATES

from prefect_robomaker.schemas.worlds.world import Floorplan
from prefect_robomaker.tasks.worldforge.floorplans import partition_choice
from prefect_robomaker.tasks.worldforge.floorplans.brief import brief
from prefect_robomaker.tasks.worldforge.floorplans.floorplan import generate_floorplan
from prefect_robomaker.tasks.worldforge.floorplans.partition_choice import capped, find_partition, plans_of
from prefect_robomaker.tasks.worldforge.floorplans.plan_seed import PlanSeed
from prefect_robomaker.tasks.worldforge.floorplans.plan_signature import signature_of
from prefect_robomaker.tasks.worldforge.seeds import seeds_for

FLAT = TEMPLATES["fits a rectangle"]
PLANS = 20


def made(job_seed: int, count: int = PLANS, *, diverse: bool = True) -> list[Floorplan]:
    return [generate_floorplan(FLAT, seeds_for(job_seed, number, 0, diverse=diverse)[0]) for number in range(count)]


def missed(plan: Floorplan) -> list[str]:
    return [wish.path for wish in plan.wishes if wish.outcome != "satisfied"]


def test_the_plans_of_a_job_differ_and_miss_one_ratio_at_most_beyond_the_best_one() -> None:
    plans = made(3)
    assert len({signature_of(plan)._replace(doors=()) for plan in plans}) == PLANS
    best = missed(made(3, 1, diverse=False)[0])
    for plan in plans:
        assert len(missed(plan)) <= len(best) + 1
        assert all(path.endswith("AspectRatio") for path in {*missed(plan)} - {*best})
        assert {wall.thickness_m for wall in plan.walls if wall.exterior} == {0.2}


def test_a_ratio_that_gave_way_says_that_plans_are_to_differ() -> None:
    reasons = {wish.reason for plan in made(3) for wish in plan.wishes if wish.outcome == "missed"}
    assert any("taken so that worlds differ (`diversity: 0`" in reason for reason in reasons)


def test_without_diversity_every_plan_is_the_best_one_with_sizes_of_its_own() -> None:
    plans = made(3, 4, diverse=False)
    assert len({signature_of(plan)._replace(doors=()) for plan in plans}) == 1
    assert len({plan.model_dump_json() for plan in plans}) > 1


def test_other_jobs_begin_with_other_plans_and_none_comes_too_often() -> None:
    pool = plans_of(brief(FLAT.floorplan))
    assert max(pool.odds) <= 0.1
    firsts = [signature_of(generate_floorplan(FLAT, seeds_for(seed, 0, 0)[0])) for seed in range(12)]
    assert len(set(firsts)) >= 6


@pytest.mark.parametrize("seed", [PlanSeed(0, 0, True), PlanSeed(2**32 - 1, 2**12 - 1, False), PlanSeed(5, 9, True)])
def test_a_seed_says_order_rank_and_whether_plans_differ(seed: PlanSeed) -> None:
    assert PlanSeed.of(seed.number) == seed


def test_the_seeds_of_a_job_depend_on_its_seed_and_the_number_of_the_plan_only() -> None:
    first, second = seeds_for(7, 0, 0), seeds_for(7, 1, 0)
    assert PlanSeed.of(first[0]).order == PlanSeed.of(second[0]).order
    assert [PlanSeed.of(each[0]).rank for each in (first, second)] == [0, 1]
    assert first[0] == seeds_for(7, 0, 5)[0], "interiors share their plan"
    assert seeds_for(8, 0, 0)[0] != first[0]


@pytest.fixture
def _no_plans_kept() -> Iterator[None]:
    """Other tests find none of the plans that a test has chosen from changed numbers."""
    plans_of.cache_clear()
    yield
    plans_of.cache_clear()


@pytest.mark.usefixtures("_no_plans_kept")
def test_the_last_digit_of_another_machine_changes_no_choice() -> None:
    numbers = brief(FLAT.floorplan)
    lists, chosen, _ = plans_of(numbers)
    number, column = chosen[-1]
    for last_digit in (-1e-15, 1e-15):
        off = lists[number].off.copy()
        off[column] = log(1.25) + last_digit
        others = [each._replace(off=off) if each is lists[number] else each for each in lists]
        plans_of.cache_clear()
        with patch.object(partition_choice, "shortlists", lambda _, others=others: others):
            assert plans_of(numbers).places == chosen


def test_ratios_that_are_off_by_just_a_limit_are_rounded() -> None:
    off = np.concatenate([each.off for each in partition_choice.shortlists(brief(TEMPLATES["guide"].floorplan))])
    at_limit = off[np.isclose(off, log(1.5), atol=1e-6)]
    assert len(set(at_limit.tolist())) == 1 < len(at_limit)


@pytest.mark.parametrize("count", [1, 2, 3, 16, 17, 18, 40])
def test_no_form_comes_first_more_often_than_it_may(count: int) -> None:
    odds = np.exp(-np.arange(count) / 1.5)
    shares = capped(odds)
    assert shares.sum() == pytest.approx(1)
    assert shares.max() == pytest.approx(max(0.06, 1 / count))
    assert (np.diff(shares) <= 1e-9).all(), "likelier ones stay so"


def test_a_template_without_plans_is_not_varied() -> None:
    found = PlanCount(2, 0, 0, 0.25, 0, 0, 0.0, 1.0, 1.0, [0.2], 0, 0)
    assert not found.is_varied


def test_without_diversity_a_search_for_bent_rooms_finds_the_same_plan_each_time() -> None:
    found: dict[bool, set[object]] = {}
    with patch.object(partition_choice, "shortlists", lambda _: []):
        for diverse in (True, False):
            numbers = brief(FLAT.floorplan, diverse=diverse)
            plans = [find_partition(numbers, PlanSeed(1, 0, diverse), Random(dice)) for dice in range(4)]
            found[diverse] = {(plan.width, plan.height, plan.arms) for plan in plans}
    assert len(found[True]) > 1 == len(found[False])
