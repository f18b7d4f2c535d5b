"""Tables about worlds."""

from helpers.hand_written_flat import describe_world

from prefect_robomaker.deployments.cli.output.world_facts import _building, _table


def test_columns_of_numbers_are_aligned_to_the_right_also_where_some_are_empty() -> None:
    lines = _table([("room", "m2")], iter([("Bath", "4"), ("Living", "24"), ("Loft", "")]))
    assert ["".join(text for text, _ in line) for line in lines] == [
        "  room    m2",
        "  Bath     4",
        "  Living  24",
        "  Loft",
    ]


def test_the_area_of_a_building_is_that_of_its_rooms_inside_the_walls() -> None:
    world = describe_world([])
    rooms = [room.model_copy(update={"floor_area_m2": 1.5}) for room in world.floorplan.rooms]
    plan = world.floorplan.model_copy(update={"rooms": rooms})
    assert _building(world.model_copy(update={"floorplan": plan}))["floor_area_m2"] == 1.5 * len(rooms)
