"""Many documents changed at once."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from typing import Any

from prefect_robomaker.schemas.documents.fleets import RobotAttributes, RobotDocument, RobotSighting
from prefect_robomaker.tasks.catalog import Catalog, NewResource

MakeResource = Callable[..., NewResource]


def robots(catalog: Catalog, make_resource: MakeResource, count: int) -> list[str]:
    document = {"version": 1, "architecture": "ARM64", "greengrassGroupId": "g"}
    made = (make_resource(number, kind="robot", status="Available", document=document) for number in range(count))
    return [catalog.create(robot, token=None).arn for robot in made]


def test_many_documents_change_at_once(catalog: Catalog, make_resource: MakeResource, clock: Any) -> None:
    arns = robots(catalog, make_resource, 3)
    before = catalog.get(arns[0])
    clock.now += timedelta(seconds=60)

    catalog.update_many(
        {arns[0]: RobotSighting(last_seen_s=7.5), arns[2]: RobotSighting(last_seen_s=8.5), "x": RobotSighting()}
    )

    found = [catalog.get(arn) for arn in arns]
    assert [RobotDocument.of(robot).last_seen_s for robot in found] == [7.5, None, 8.5]
    assert [RobotDocument.of(robot).architecture for robot in found] == ["ARM64"] * 3
    assert [robot.revision for robot in found] == [2, 1, 2]
    assert found[0].updated_at - before.updated_at == timedelta(seconds=60)
    catalog.update_many({})


def test_no_change_is_lost_to_changes_of_many(catalog: Catalog, make_resource: MakeResource) -> None:
    arns = robots(catalog, make_resource, 4)

    def see(number: int) -> None:
        catalog.update_many({arn: RobotSighting(last_seen_s=float(number)) for arn in arns})

    def describe(number: int) -> None:
        catalog.update(arns[number % 4], RobotAttributes(attributes={"number": str(number)}))

    with ThreadPoolExecutor(4) as pool:
        for done in [pool.submit(each, number) for number in range(20) for each in (see, describe)]:
            done.result()

    for arn in arns:
        document = RobotDocument.of(catalog.get(arn))
        assert document.last_seen_s is not None
        assert document.attributes is not None
        assert catalog.get(arn).revision == 1 + 20 + 5
