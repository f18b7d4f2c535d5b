from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from prefect_robomaker.tasks.runtime.applications.indoor_navigation.environment import make_environment
from prefect_robomaker.tasks.runtime.applications.indoor_navigation.scene_markers import goal_markers
from prefect_robomaker.tasks.runtime.recording.recording import McapRecorder


def record(make_context, path: Path, action: tuple[float, float], steps: int, heading: float) -> tuple[Any, dict]:
    messages: dict[str, list[Any]] = {}
    with McapRecorder(path) as recorder:
        environment = make_environment(make_context(recorder=recorder))
        environment.reset()
        data = environment.physics.data.ptr
        start = environment.physics.model.ptr.joint("scout/base").qposadr[0]
        data.qpos[start + 3 : start + 7] = (np.cos(heading / 2), 0, 0, np.sin(heading / 2))
        for _ in range(steps):
            environment.step(np.array(action))
    with path.open("rb") as stream:
        for item in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            messages.setdefault(item.channel.topic, []).append((item.message.log_time / 1e9, item.decoded_message))
    return environment.run_result(), messages


def test_contacts_are_drawn_where_and_while_they_last(make_context, tmp_path: Path) -> None:
    report, messages = record(make_context, tmp_path / "r.mcap", (0.5, 0.0), 60, -np.pi / 2)
    (collision,) = report.collisions
    times = [time_s for time_s, _ in messages["/contacts"]]
    assert times[0] == pytest.approx(collision.time_s, abs=0.011)
    assert times[-1] == pytest.approx(collision.time_s + collision.duration_s, abs=0.021)
    assert np.diff(times).min() >= 0.019
    forces = []
    for _, message in messages["/contacts"]:
        assert {arrow.ns for arrow in message.markers} == {"wall"}
        forces.append(sum(float(arrow.text.removesuffix(" N")) for arrow in message.markers))
    assert max(forces) == pytest.approx(collision.max_force_N, rel=0.1)
    for arrow in (arrow for _, message in messages["/contacts"] for arrow in message.markers):
        start, end = arrow.points
        assert (start.x, start.y) == pytest.approx((0.0, -0.95), abs=0.05)
        assert (end.x - start.x, end.z - start.z) == pytest.approx((0, 0), abs=0.01)
        assert end.y >= start.y  # the wall in the south pushes the robot to the north
        assert arrow.text == f"{(end.y - start.y) / 0.01:.1f} N"


def test_goals_are_called_what_users_called_their_rooms(make_context) -> None:
    first, *others = make_context().world.floorplan.rooms
    rooms = [first.model_copy(update={"original_name": "Küche"}), *others]
    markers = goal_markers(rooms, [False] * len(rooms), 0.0, "map").markers
    assert [marker.text for marker in markers if marker.text] == ["Küche", *(room.name for room in others)]


def test_goals_turn_green_when_their_rooms_were_visited(make_context, tmp_path: Path) -> None:
    report, messages = record(make_context, tmp_path / "r.mcap", (0.5, 0.0), 2, 0.0)
    [(_, before), (_, after)] = messages["/goals"]
    assert "/contacts" not in messages
    discs, names = ([m for m in after.markers if m.type == kind] for kind in (2 + 1, 9))
    assert [name.text for name in names] == ["hall", "living", "kitchen"]
    assert (discs[1].pose.position.x, discs[1].pose.position.y) == (0.0, 2.2)
    green = [disc.color.g > disc.color.r for disc in discs]
    assert green == [room.visited for room in report.rooms] == [True, False, False]
    assert not any(marker.color.g > marker.color.r for marker in before.markers)
