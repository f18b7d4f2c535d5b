"""Cards of two jobs side by side: what they say of the first miss is about one requirement."""

from helpers.night_records import make_job

from prefect_robomaker.schemas.runs.plan import Requirement
from prefect_robomaker.tasks.reporting.nights.beside import Drive, PairPainter


def test_the_place_of_the_first_miss_is_that_of_the_named_requirement() -> None:
    missed = [
        Requirement(name="z_soft", satisfied=False, detail="", first_violation_s=2.0, room="Hall", other="chair_3"),
        Requirement(name="a_slow", satisfied=False, detail="", first_violation_s=2.0, room="Bath"),
    ]
    job = make_job(0, "F").model_copy(update={"requirements": missed})
    card = PairPainter(lambda *_: "").card(1, (job, job), "drive", [], (Drive(), Drive()))
    assert [side.first_miss for side in card.sides] == ["first missed a slow at 2.0 s, in Bath"] * 2
