"""Many documents changed at once."""

import threading
from collections.abc import Callable
from datetime import timedelta
from typing import Any

from prefect_robomaker.schemas.fleet.documents import RobotAttributes, RobotDocument, RobotSighting
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


def test_no_change_of_another_is_lost(catalog: Catalog, make_resource: MakeResource) -> None:
    (robot,) = robots(catalog, make_resource, 1)
    described = RobotAttributes(attributes={"name": "rover"})
    other = threading.Thread(target=catalog.update, args=(robot, described))

    class Slow(RobotSighting):
        def to_json(self) -> dict[str, Any]:
            other.start()
            other.join(0.3)  # it has to wait for the end of this
            return super().to_json()

    catalog.update_many({robot: Slow(last_seen_s=1.0)})
    other.join()

    document = RobotDocument.of(catalog.get(robot))
    assert (document.last_seen_s, document.attributes) == (1.0, {"name": "rover"})
    assert catalog.get(robot).revision == 3
