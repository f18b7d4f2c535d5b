"""The page about robots of ROS 1, executed with the real roslaunch, rosmaster and rospy."""

import math
import re
import shutil
import subprocess
import tarfile
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from helpers.paths import REPOSITORY
from helpers.real_engine import RealEngine
from helpers.ros1_nodes import NEEDS_ROS_1, PYTHON
from helpers.small_flat import BODY, ROLE
from helpers.swing_fixtures import outputs_of
from rosbags.highlevel import AnyReader

from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.inspection.replays import verify_run
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worlds.keeping import keep_world

pytestmark = [pytest.mark.deep, *NEEDS_ROS_1]

PAGE = REPOSITORY / "docs" / "ros1.md"


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
    monkeypatch.setenv("ROBOMAKER_HOME", str(home))
    monkeypatch.setenv("PYTHONPATH", str(ros1_messages))  # which Debian has as packages
    monkeypatch.chdir(tmp_path)
    ended = None
    for command in commands_of_page():
        if command.startswith("robomaker "):
            ended = robomaker_at_server(*command.split()[1:], "-o", "json")
        else:
            subprocess.run(["bash", "-c", command], check=True, cwd=tmp_path)
    assert ended is not None
    record = RunRecord.model_validate_json(ended.out)
    (job,) = record.jobs

    assert (job.status, job.verdict, ended.code) == ("Completed", "FAIL", 1), ended.err
    assert job.runs_free, "paced time depends on the machine's"
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


IN_CONTAINER = """
python3 -c "import rosmaster; rosmaster.rosmaster_main()" --core -p ${ROS_MASTER_URI##*:} &
until python3 -c "import rospy; rospy.set_param('/use_sim_time', True)" 2>/dev/null; do sleep 0.1; done
exec python3 -c "$NODE"
"""


def add_image(engine: RealEngine, folder: Path, messages: Path) -> str:
    """An image of this machine's Python and rospy, as small as images of ROS 1 can be."""
    found = subprocess.run([PYTHON, "-c", PACKAGES_OF_ROSPY], capture_output=True, text=True, check=True).stdout.split()
    root = folder / "ros.tar"
    shutil.copyfile(engine.root(python=True), root)
    with tarfile.open(root, "a") as tar:
        place = tarfile.TarInfo("ros")  # engines let only root look into folders that are in no archive
        place.type, place.mode = tarfile.DIRTYPE, 0o755
        tar.addfile(place)
        for path in map(Path, found):
            tar.add(path, arcname=f"ros/{path.name}")
        # Python loads it when a thread ends.
        tar.add(Path(_LIBGCC).resolve(), arcname=_LIBGCC)
        for path in messages.iterdir():
            tar.add(path, arcname=f"ros/{path.name}")
    image = engine.note_image(f"{engine.prefix}/rospy:1")
    changes = ("USER robo", "ENV PYTHONPATH=/ros PATH=/usr/bin:/bin ROS_LOG_DIR=/tmp/log")
    engine.call("import", *(word for each in changes for word in ("--change", each)), str(root), image)
    return image


_LIBGCC = "/lib/x86_64-linux-gnu/libgcc_s.so.1"
PACKAGES_OF_ROSPY = """
import pathlib, sys, netifaces, rospy, rosmaster.main, rosgraph_msgs.msg
for name in {name.partition(".")[0] for name in list(sys.modules)}:
    file = getattr(sys.modules.get(name), "__file__", None) or ""
    if "dist-packages" in file:
        print(pathlib.Path(file).parent if file.endswith("__init__.py") else file)
"""


def test_nodes_in_a_container_drive_through_the_bridge_in_it(
    service: Service, real_engine: RealEngine, tmp_path: Path, ros1_messages: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", real_engine.program)
    for name, value in real_engine.environ.items():
        monkeypatch.setenv(name, value)
    service.store.ensure_bucket("results")
    image = add_image(real_engine, tmp_path, ros1_messages)
    suite = {"name": "ROS", "version": "Melodic"}
    call(
        "CreateRobotApplication", {"name": "robot", "robotSoftwareSuite": suite, "environment": {"uri": image}}, service
    )
    world = keep_world(
        generate_world(WorldTemplateBody.model_validate({**BODY, "Version": "2"}), 1, 2), "import", {}, service
    )
    node = files_of_page()["my_robot/nodes/rotate"].partition("\n")[2]
    limit = {"environmentVariables": {"ROBOMAKER_SIM_TIME_LIMIT_S": "6"}}
    launch = {"command": ["bash", "-c", IN_CONTAINER], "environmentVariables": {"NODE": node}}
    request = {
        "maxJobDurationInSeconds": 600, "iamRole": ROLE, "outputLocation": {"s3Bucket": "results"},
        "simulationApplications": [
            {"application": "indoor-navigation", "launchConfig": limit, "worldConfigs": [{"world": world.arn}]}
        ],
        "robotApplications": [{"application": "robot", "launchConfig": launch}],
    }  # fmt: skip
    arn = call("CreateSimulationJob", request, service)["arn"]

    perform_job(arn, service)

    job = call("DescribeSimulationJob", {"job": arn}, service)
    assert job["status"] == "Completed", job["failureReason"]
    outputs = outputs_of(service, job)
    ros = RunResult.model_validate_json((outputs / "result.json").read_bytes()).extra["ros"]
    assert ros["commands"] > 10
    assert ros["heard"] == ["/clock"]
    began, *_, last = yaws_rad(outputs)
    assert 0.1 < (last - began) % math.tau < 0.65
    assert "nodes: 1 send /cmd_vel" in (outputs / "logs" / "robot.ros-bridge.stderr.log").read_text()
    again = verify_run(arn, service)
    assert (again.answer, again.robot) == ("bit-identical", "recorded actions"), str(again)
