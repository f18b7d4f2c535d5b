"""Tables about worlds."""

from prefect_robomaker.deployments.cli.output.world_facts import _table


def test_columns_of_numbers_are_aligned_to_the_right_also_where_some_are_empty() -> None:
    lines = _table([("room", "m2")], iter([("Bath", "4"), ("Living", "24"), ("Loft", "")]))
    assert ["".join(text for text, _ in line) for line in lines] == [
        "  room    m2",
        "  Bath     4",
        "  Living  24",
        "  Loft",
    ]
