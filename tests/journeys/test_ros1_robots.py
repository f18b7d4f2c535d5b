"""The page about robots of ROS 1, executed with the real roslaunch, rosmaster and rospy."""

import math
import re
import subprocess
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from helpers.paths import REPOSITORY
from helpers.ros1_nodes import NEEDS_ROS_1
from rosbags.highlevel import AnyReader

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.runs.plan import RunResult

pytestmark = [pytest.mark.deep, *NEEDS_ROS_1]

PAGE = REPOSITORY / "docs" / "ros1.md"
_HOME = "~/.local/share/robomaker"


def files_of_page() -> dict[str, str]:
    return dict(re.findall(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", PAGE.read_text(), re.S))


def commands_of_page() -> list[str]:
    blocks = re.findall(r"<!-- run -->\n```console\n(.*?)```", PAGE.read_text(), re.S)
    return [line.removeprefix("$ ") for block in blocks for line in block.splitlines()]


def yaws_rad(folder: Path) -> list[float]:
    """Yaw of a recording's odometry."""
    with AnyReader([folder]) as reader:
        connections = [each for each in reader.connections if each.topic == "/odom"]
        turned = [
            reader.deserialize(data, connection.msgtype).pose.pose.orientation  # type: ignore[attr-defined]
            for connection, _, data in reader.messages(connections)
        ]
    return [2 * math.atan2(each.z, each.w) for each in turned]


def test_the_robot_of_the_page_turns_scout_in_a_generated_flat(
    robomaker_at_server, home: Path, tmp_path: Path, ros1_messages: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, text in files_of_page().items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setenv("PYTHONPATH", str(ros1_messages))  # which Debian has as packages
    monkeypatch.chdir(tmp_path)
    ended = None
    for command in commands_of_page():
        if command.startswith("robomaker "):
            ended = robomaker_at_server(*command.split()[1:], "-o", "json")
        else:
            subprocess.run(["bash", "-c", command.replace(_HOME, str(home))], check=True, cwd=tmp_path)
    assert ended is not None
    record = RunRecord.model_validate_json(ended.out)
    (job,) = record.jobs

    assert (job.status, job.verdict, ended.code) == ("Completed", "FAIL", 1), ended.err
    outputs = Path(unquote(urlsplit(job.output_uri or "").path))
    result = RunResult.model_validate_json((outputs / "result.json").read_bytes())
    assert result.sim_time_s == pytest.approx(15.0)
    began, *_, last = yaws_rad(outputs)
    turned_rad = (last - began) % math.tau
    assert 0.5 < turned_rad <= 1.52, "0.1 rad/s for 15 s; a busy machine begins later"
    ros = result.extra["ros"]
    assert ros["commands"] > 50
    assert "/clock" in ros["heard"], "ten commands a second of simulated time, not of the machine's"
    assert result.notes == []
    assert result.tools == [], "the bridge ends no sooner than the run"
    said = (outputs / "logs" / "robot.ros-bridge.stderr.log").read_text()
    assert "nodes: 1 send /cmd_vel; heard: /clock" in said
