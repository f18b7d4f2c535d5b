"""The catalogue: one entry says everything of a kind."""

from prefect_robomaker.schemas.worlds.world import MODEL_TYPES
from prefect_robomaker.tasks.worldforge.furniture.catalogue import CATALOGUE, LOOSE_TYPES, RULES
from prefect_robomaker.tasks.worldforge.pictures.plan_symbols import symbol


def test_it_has_every_kind_and_a_rule_for_those_that_templates_name() -> None:
    assert set(CATALOGUE) == {*MODEL_TYPES, *LOOSE_TYPES}
    assert set(RULES) == set(MODEL_TYPES)


def test_plans_know_the_symbol_of_each_kind() -> None:
    for name, kind in CATALOGUE.items():
        drawn = symbol(name, 0.6, 0.9)
        assert (drawn == symbol("NoSuchKind", 0.6, 0.9)) == (kind.symbol == "plain")
