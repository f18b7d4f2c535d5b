import numpy as np
import pytest

from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment


def drive(make_context, action: tuple[float, float], steps: int, heading: float, **context):
    environment = make_environment(make_context(**context))
    environment.reset()
    data = environment.physics.data.ptr
    start = environment.physics.model.ptr.joint("scout/base").qposadr[0]
    data.qpos[start + 3 : start + 7] = (np.cos(heading / 2), 0, 0, np.sin(heading / 2))
    for _ in range(steps):
        environment.step(np.array(action))
    return environment.run_result()


def test_hitting_a_wall_at_speed_is_one_hard_collision_and_fails(make_context) -> None:
    report = drive(make_context, (0.5, 0.0), 60, -np.pi / 2)
    (collision,) = report.collisions
    assert collision.other == "wall"
    assert collision.max_force_N > 20
    assert collision.time_s == pytest.approx(0.78 / 0.5, abs=0.5)
    assert (collision.x, collision.y) == pytest.approx((0.0, -0.78), abs=0.05)
    assert collision.duration_s > 0.5
    assert report.verdict == "FAIL"
    assert {item.name for item in report.requirements if not item.satisfied} >= {"no_hard_collision"}


def test_pushing_a_loose_thing_slowly_is_a_soft_touch_by_its_name(make_context) -> None:
    report = drive(make_context, (0.08, 0.0), 120, 0.0, loose=[("Toy_1", 0.4, 0.0, 0.06)])
    assert {collision.other for collision in report.collisions} == {"Toy_1"}
    assert 0 < report.metrics["max_collision_force_N"] < 20


def test_furniture_is_named_by_its_id(make_context) -> None:
    report = drive(make_context, (0.5, 0.0), 260, 0.0)
    assert {collision.other for collision in report.collisions} == {"Hall/Storage-1"}


def test_driving_on_the_floor_touches_nothing(make_context) -> None:
    report = drive(make_context, (0.3, 1.0), 100, 0.0)
    assert report.collisions == []
    assert report.metrics["collisions"] == 0
