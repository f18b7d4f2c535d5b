"""Words about results that a run with `--reuse` takes over."""

from prefect_robomaker.deployments.cli.output.forecast import why_nothing
from prefect_robomaker.tasks.inspection.reuse_plans import NEW_WORLD, NO_SEED, PlannedPart


def test_why_nothing_is_taken_over() -> None:
    worlds = [PlannedPart(f"world {number}", reuse=False, why=NO_SEED) for number in (1, 2)]
    jobs = [PlannedPart("request 1", reuse=False, why=NEW_WORLD)]
    assert why_nothing({"worlds": worlds, "drive": jobs}) == (
        "--reuse takes nothing over: worlds: no seed is given, so each run draws its own"
    )
    assert why_nothing({"drive": jobs}) == "--reuse takes nothing over: drive: its world is generated first"
    taken = PlannedPart("world 1", reuse=True, why="found in generation-1")
    assert why_nothing({"worlds": [taken], "drive": jobs}) is None
    assert why_nothing({}) is None
