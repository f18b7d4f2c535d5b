"""Nodes of the real ROS 2 (rclpy, Fast DDS) that know nothing of this product, driving in generated flats."""

import itertools
import json
import os
import re
import shutil
import subprocess
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import boto3
import pytest
from botocore.config import Config
from helpers.endpoint_process import Serve
from helpers.paths import REPOSITORY
from helpers.processes import wait_for
from helpers.rclpy_nodes import rclpy as rclpy  # a fixture
from helpers.real_engine import RealEngine
from helpers.small_flat import BODY, ROLE
from helpers.swing_fixtures import outputs_of

from prefect_robomaker.deployments.cli.main import main
from prefect_robomaker.schemas.reports.run_record import RunRecord
from prefect_robomaker.schemas.runs.plan import RunResult
from prefect_robomaker.schemas.specs import sabotages
from prefect_robomaker.schemas.specs.sabotages import BUILT_IN
from prefect_robomaker.schemas.templates.body import WorldTemplateBody
from prefect_robomaker.tasks.inspection.replays import verify_run
from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz
from prefect_robomaker.tasks.worldforge.generator import generate_world
from prefect_robomaker.tasks.worlds.keeping import keep_world

pytestmark = [pytest.mark.deep, pytest.mark.timeout(900)]

PAGE = REPOSITORY / "docs" / "ros2.md"
SUITE = {"name": "ROS2", "version": "Foxy"}


def files_of_page() -> dict[str, str]:
    return dict(re.findall(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", PAGE.read_text(), re.S))


def commands_of_page(mark: str = "run") -> list[str]:
    blocks = re.findall(rf"<!-- {mark} -->\n```console\n(.*?)```", PAGE.read_text(), re.S)
    return [line.removeprefix("$ ") for block in blocks for line in block.splitlines()]


def in_shell(command: str, home: Path, folder: Path) -> None:
    subprocess.run(["bash", "-c", command], check=True, cwd=folder, env={**os.environ, "ROBOMAKER_HOME": str(home)})


def write_files_of_page(folder: Path, python: Path) -> None:
    for name, text in files_of_page().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        # Where ROS is installed is the only thing that differs here.
        text = text.replace("source /opt/ros/jazzy/setup.bash\n", "").replace("/usr/bin/python3", str(python))
        (folder / name).write_text(text)


def test_a_node_drives_by_a_specification_and_is_repeated_to_the_bit(
    robomaker_at_server, home: Path, tmp_path: Path, rclpy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_files_of_page(tmp_path, rclpy)
    monkeypatch.chdir(tmp_path)
    records = []
    for command in [*commands_of_page(), "robomaker run drive.yaml"]:
        if command.startswith("robomaker "):
            ended = robomaker_at_server(*command.split()[1:], "-o", "json")
            assert ended.code == 0, ended.err
            records.append(RunRecord.model_validate_json(ended.out))
        else:
            in_shell(command, home, tmp_path)
    folders = []
    for record in records:
        (job,) = record.jobs
        assert (job.status, job.verdict, job.runs_free) == ("Completed", "PASS", False)
        folders.append(Path(unquote(urlsplit(job.output_uri or "").path)))
    result = RunResult.model_validate_json((folders[0] / "result.json").read_bytes())
    ros = result.extra["ros"]
    assert (ros["time"], ros["unanswered"], ros["heard"]) == ("lockstep", 0, ["/clock", "/scan"])
    assert ros["commands"] == ros["sent"]["/scan"] == 300
    assert result.notes == []
    # Two runs of a node in another process, on a machine that is as busy as it is, and the same states.
    digests = [(folder / "digest.bin").read_bytes() for folder in folders]
    assert digests[0] == digests[1]
    verified = robomaker_at_server("verify", records[0].jobs[0].arn.rpartition("/")[2])
    assert verified.code == 0, verified.err
    assert "bit-identical" in verified.out
    assert list((home / "runs").glob("*/report.html"))


def test_a_node_without_ros_drives_as_the_page_says(
    robomaker_at_server, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_files_of_page(tmp_path, Path("python3"))
    monkeypatch.chdir(tmp_path)
    *before, run = commands_of_page("run without ROS")
    for command in before:
        in_shell(command, home, tmp_path)
    ended = robomaker_at_server(*run.split()[1:], "-o", "json")
    assert ended.code == 0, ended.err
    (job,) = RunRecord.model_validate_json(ended.out).jobs
    assert (job.status, job.verdict, job.runs_free) == ("Completed", "PASS", False)
    assert job.remarks == []


@pytest.mark.endurance  # what is sabotaged is the simulation, whoever drives: test_challenge.py has it with a program
def test_a_node_is_sabotaged_on_the_simulations_side_of_the_bridge(
    robomaker_at_server, home: Path, tmp_path: Path, rclpy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sabotages, "BUILT_IN", tuple(each for each in BUILT_IN if each.name in ("idle", "blind")))
    write_files_of_page(tmp_path, rclpy)
    monkeypatch.chdir(tmp_path)
    for command in commands_of_page():
        if not command.startswith("robomaker "):
            in_shell(command, home, tmp_path)
    challenged = robomaker_at_server("challenge", "drive.yaml", "--jobs", "1")
    lines = {line.split("  ")[1]: line for line in challenged.out.splitlines() if line.startswith("  ")}
    assert "caught by the only job" in lines["idle"], challenged.out + challenged.err
    assert "no effect" not in lines["blind"], "the node drives by the scan"


Ending = tuple[dict[str, Any], RunResult | None]


@pytest.fixture
def driven(service: Service, tmp_path: Path, rclpy: Path) -> Callable[..., Ending]:
    """Runs a job whose robot is a node of a few lines, in a flat of two rooms."""
    for bucket in ("applications", "results"):
        service.store.ensure_bucket(bucket)
    body = WorldTemplateBody.model_validate({**BODY, "Version": "2"})
    world = keep_world(generate_world(body, 1, 2), "import", {}, service)

    numbers = itertools.count()

    def run(code: str, *, limit_s: float = 10.0, connect_s: int = 300, **options: Any) -> Ending:
        bundle = tmp_path / "bundle"
        bundle.mkdir(exist_ok=True)
        (bundle / "node.py").write_text(PREAMBLE + code)
        pack_tar_gz(bundle, tmp_path / "bundle.tar.gz")
        service.store.put_file("applications", "node.tar.gz", tmp_path / "bundle.tar.gz")
        source = {"sources": [{"s3Bucket": "applications", "s3Key": "node.tar.gz"}]}
        name = f"node-{next(numbers)}"
        call("CreateRobotApplication", {"name": name, "robotSoftwareSuite": SUITE, **source}, service)
        limit = {"environmentVariables": {"ROBOMAKER_SIM_TIME_LIMIT_S": str(limit_s)}}
        launch = {"command": [str(rclpy), "node.py"], "environmentVariables": {"ROBOMAKER_ROS": json.dumps(options)}}
        launch["environmentVariables"]["ROBOMAKER_AGENT_CONNECT_TIMEOUT_S"] = str(connect_s)
        request = {
            "maxJobDurationInSeconds": 600, "iamRole": ROLE, "outputLocation": {"s3Bucket": "results"},
            "simulationApplications": [
                {"application": "indoor-navigation", "launchConfig": limit, "worldConfigs": [{"world": world.arn}]}
            ],
            "robotApplications": [{"application": name, "launchConfig": launch}],
        }  # fmt: skip
        arn = call("CreateSimulationJob", request, service)["arn"]
        perform_job(arn, service)
        job = call("DescribeSimulationJob", {"job": arn}, service)
        outputs = outputs_of(service, job)
        found = outputs / "result.json"
        return job, RunResult.model_validate_json(found.read_bytes()) if found.exists() else None

    return run


PREAMBLE = """
import math, os, time, rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String
rclpy.init()
node = Node("driver", parameter_overrides=[Parameter("use_sim_time", value=True)])
"""
TURNS = """
commands = node.create_publisher(Twist, "/cmd_vel", 10)
def turn():
    command = Twist()
    command.angular.z = 0.1
    commands.publish(command)
node.create_timer(0.1, turn)
rclpy.spin(node)
"""


def test_a_timer_in_simulated_time_drives_paced_and_is_named_in_lockstep(driven: Callable[..., Ending]) -> None:
    job, result = driven(TURNS)
    assert job["status"] == "Completed", job
    assert result is not None
    assert result.extra["ros"]["commands"] >= 80  # ten a simulated second, but for the first moments
    assert result.extra["ros"]["time"] == "paced"
    job, _ = driven(TURNS.replace("0.1, turn", "0.5, turn"), time="lockstep", answer_timeout_s=0.5)
    assert (job["status"], job["failureCode"]) == ("Failed", "RobotApplicationCrash")
    assert "commands by a timer" in job["failureReason"]


def test_late_and_best_effort_subscribers_get_what_they_ask_for(driven: Callable[..., Ending]) -> None:
    code = """
commands = node.create_publisher(TwistStamped, "/cmd_vel", 10)
got = {"scan": 0, "map": 0}
def mapped(map):
    got.update(map=map.info.width)
    commands.publish(got.pop("held"))  # the step whose answer waited for the map, which comes when it comes
def scanned(scan):
    got["scan"] += 1
    command = TwistStamped()
    command.header.stamp = scan.header.stamp
    command.twist.angular.z = 0.2
    if got["scan"] == 10:
        got["held"] = command
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(OccupancyGrid, "/map", mapped, latched)
    else:
        commands.publish(command)
    print(got, flush=True)
node.create_subscription(LaserScan, "/scan", scanned, qos_profile_sensor_data)
rclpy.spin(node)
"""
    options = {"localization": "truth", "time": "lockstep", "answer_timeout_s": 200.0, "topics": {"/imu": None}}
    job, result = driven(code, **options)
    assert job["status"] == "Completed", job
    assert result is not None
    assert "/imu" not in result.extra["ros"]["sent"]
    assert result.extra["ros"]["unanswered"] == 0
    assert result.extra["ros"]["sent"]["/map"] == 1
    assert "/map" in result.extra["ros"]["heard"]


NEVER = {"connect_s": 20}
"""Seconds that are waited for a node that never comes; one that comes may take a busy machine longer."""
ENDS = {
    "a number that is none": (
        TURNS.replace("= 0.1\n", "= math.nan\n"), {}, "RobotApplicationCrash", "not finite",
    ),
    "another type": (
        'commands = node.create_publisher(String, "/cmd_vel", 10)\nrclpy.spin(node)', NEVER,
        "RobotApplicationHealthCheckFailure", "found there: /cmd_vel with std_msgs/msg/String",
    ),
    "no node": (
        "node.destroy_node()\ntime.sleep(600)", NEVER, "RobotApplicationHealthCheckFailure", "found there: no node",
    ),
    "silence": (
        "rclpy.spin(node)", {}, "RobotApplicationHealthCheckFailure",
        "publishes geometry_msgs/Twist or TwistStamped on /cmd_vel; of the simulation's topics the nodes listen to "
        "/clock",
    ),
    "a death": (
        TURNS.replace("def turn():", "def turn():\n    if node.get_clock().now().nanoseconds > 3e9: os._exit(3)"), {},
        "RobotApplicationCrash", "exited with code 3",
    ),
}  # fmt: skip


OF_JUDGES = ("a number that is none", "another type")
"""Real nodes do what tests/tasks/runtime/ros/test_ros_robot.py asks of scripted ones."""


@pytest.mark.parametrize(
    "case", [pytest.param(each, marks=pytest.mark.endurance if each in OF_JUDGES else ()) for each in ENDS]
)
def test_nodes_that_fail_end_their_job_with_the_reason(driven: Callable[..., Ending], case: str) -> None:
    code, options, failure, said = ENDS[case]
    job, _ = driven(code, **options)
    assert (job["status"], job["failureCode"]) == ("Failed", failure), job
    assert said in job["failureReason"]


def test_a_flood_of_commands_slows_nothing_down(driven: Callable[..., Ending]) -> None:
    code = """
commands = node.create_publisher(Twist, "/cmd_vel", 10)
command = Twist()
command.angular.z = 0.1
while True:
    commands.publish(command)
    rclpy.spin_once(node, timeout_sec=0.0)
"""
    job, result = driven(code, time="free", real_time_factor=5.0)
    assert job["status"] == "Completed", job
    assert result is not None
    assert result.sim_time_s == pytest.approx(10.0)
    assert 100 <= result.extra["ros"]["commands"] <= 200  # one a step


@pytest.mark.endurance  # test_boto3.py is its client, and the first test above its node
def test_an_unchanged_client_has_its_node_driven_over_http(
    service: Service, serve: Serve, tmp_path: Path, rclpy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert main(["sdk-model", "--install"]) == 0
    monkeypatch.setenv("AWS_DATA_PATH", str(tmp_path / ".aws" / "models"))
    write_files_of_page(tmp_path, rclpy)
    (tmp_path / "my_driver" / "drive.sh").chmod(0o755)
    pack_tar_gz(tmp_path / "my_driver", tmp_path / "driver.tar.gz")
    for bucket in ("applications", "results"):
        service.store.ensure_bucket(bucket)
    service.store.put_file("applications", "driver.tar.gz", tmp_path / "driver.tar.gz")
    body = WorldTemplateBody.model_validate({**BODY, "Version": "2"})
    world = keep_world(generate_world(body, 1, 2), "import", {}, service)
    with serve(ROBOMAKER_SANDBOX_SHOW=str(rclpy.parents[1])) as endpoint:
        endpoint.wait_until_ready()
        session: Any = boto3.session.Session()
        client = session.client(
            "robomaker", region_name=service.settings.region, endpoint_url=endpoint.url,
            aws_access_key_id="local", aws_secret_access_key="local", config=Config(retries={"total_max_attempts": 1}),
        )  # fmt: skip
        application = client.create_robot_application(
            name="driver", robotSoftwareSuite=SUITE, sources=[{"s3Bucket": "applications", "s3Key": "driver.tar.gz"}]
        )
        job = client.create_simulation_job(
            maxJobDurationInSeconds=600, iamRole=ROLE, outputLocation={"s3Bucket": "results"},
            robotApplications=[{"application": application["arn"], "launchConfig": {"command": ["./drive.sh"]}}],
            simulationApplications=[
                {
                    "application": "indoor-navigation", "worldConfigs": [{"world": world.arn}],
                    "launchConfig": {"environmentVariables": {"ROBOMAKER_SIM_TIME_LIMIT_S": "8"}},
                }
            ],
        )["arn"]  # fmt: skip

        def ended() -> bool:
            return client.describe_simulation_job(job=job)["status"] in ("Completed", "Failed")

        wait_for(ended, "the job's end", 600)
        told = client.describe_simulation_job(job=job)
    assert told["status"] == "Completed", told
    result = RunResult.model_validate_json((outputs_of(service, told) / "result.json").read_bytes())
    assert result.extra["ros"]["commands"] > 20
    assert result.extra["ros"]["time"] == "paced"


_NOT_IN_IMAGES = ("/include/", "/cmake/", "/tests/", "/setuptools/", "/numpy/f2py/", "/tools/")


def add_image(engine: RealEngine, folder: Path, environment: Path) -> str:
    """An image of this machine's Python, and of rclpy from its wheels in a prefix as `/opt/ros` has."""
    root = folder / "ros.tar"
    shutil.copyfile(engine.root(python=True), root)
    kept = [
        path
        for path in sorted((environment / "lib").rglob("*"))
        if not any(part in f"{path}/" for part in _NOT_IN_IMAGES) and path.suffix != ".a"
    ]
    libraries = [str(path) for path in kept if ".so" in path.name and path.is_file()]
    (packages,) = (environment / "lib").glob("python3*/site-packages")
    folders = [environment / "lib", *sorted(packages.glob("*.libs"))]  # where wheels have what they were linked with
    searched = {**os.environ, "LD_LIBRARY_PATH": ":".join(map(str, folders))}
    listed = subprocess.run(["ldd", *libraries], capture_output=True, text=True, env=searched, check=False).stdout
    with tarfile.open(root, "a") as tar:
        already = set(tar.getnames())
        for needed in sorted(set(re.findall(r"=> (/\S+) \(0x", listed))):
            if not Path(needed).is_relative_to(environment) and needed.lstrip("/") not in already:
                tar.add(Path(needed).resolve(), arcname=needed)
        for place in ("ros", "ros/lib", "ros/share"):  # engines let only root look into folders that are in no archive
            member = tarfile.TarInfo(place)
            member.type, member.mode = tarfile.DIRTYPE, 0o755
            tar.addfile(member)
        for path in kept:
            tar.add(path, arcname=f"ros/{path.relative_to(environment)}", recursive=False)
        tar.add(environment / "share" / "ament_index", arcname="ros/share/ament_index")
    image = engine.note_image(f"{engine.prefix}/rclpy:1")
    python_path = f"/ros/{packages.relative_to(environment)}"
    library_path = ":".join(f"/ros/{path.relative_to(environment)}" for path in folders)
    found = f"PYTHONPATH={python_path} LD_LIBRARY_PATH={library_path} AMENT_PREFIX_PATH=/ros PATH=/usr/bin:/bin"
    changes = ("USER robo", f"ENV {found} ROS_LOG_DIR=/tmp/log")
    engine.call("import", *(word for each in changes for word in ("--change", each)), str(root), image)
    return image


def test_nodes_in_a_container_drive_by_dds(
    service: Service, real_engine: RealEngine, tmp_path: Path, rclpy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROBOMAKER_CONTAINER_ENGINE", real_engine.program)
    for name, value in real_engine.environ.items():
        monkeypatch.setenv(name, value)
    service.store.ensure_bucket("results")
    image = add_image(real_engine, tmp_path, rclpy.parents[1])
    about = {"name": "robot", "robotSoftwareSuite": SUITE, "environment": {"uri": image}}
    call("CreateRobotApplication", about, service)
    world = keep_world(
        generate_world(WorldTemplateBody.model_validate({**BODY, "Version": "2"}), 1, 2), "import", {}, service
    )
    variables = {"NODE": files_of_page()["my_driver/drive.py"]}
    variables["ROBOMAKER_ROS"] = json.dumps({"time": "lockstep", "answer_timeout_s": 200.0})
    limit = {"environmentVariables": {"ROBOMAKER_SIM_TIME_LIMIT_S": "6"}}
    launch = {"command": ["bash", "-c", 'exec python3 -c "$NODE"'], "environmentVariables": variables}
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
    ros = RunResult.model_validate_json((outputs_of(service, job) / "result.json").read_bytes()).extra["ros"]
    assert (ros["time"], ros["unanswered"], ros["heard"]) == ("lockstep", 0, ["/clock", "/scan"])
    assert ros["commands"] == ros["sent"]["/scan"] == 30
    again = verify_run(arn, service)
    assert (again.answer, again.robot) == ("bit-identical", "recorded actions"), str(again)
