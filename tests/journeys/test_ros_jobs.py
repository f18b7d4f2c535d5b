"""Jobs whose applications are packages of ROS 1, started by the real roslaunch with a real master.

Debian has them as python3-roslaunch, python3-rosmaster and rosout; where they are missing, these tests say so.
"""

import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from helpers.colcon_bundles import bundle_v1, bundle_v2
from helpers.processes import wait_for, working_below
from helpers.required_programs import needs
from helpers.run_processes import processes_with
from helpers.small_flat import ROLE
from rosbags.highlevel import AnyReader

from prefect_robomaker.tasks.jobs.job_runs import perform_job
from prefect_robomaker.tasks.operations.registry import call
from prefect_robomaker.tasks.service.service import Service
from prefect_robomaker.tasks.storage import pack_tar_gz

pytestmark = [
    pytest.mark.deep,
    needs(
        "ros",
        shutil.which("roslaunch") and shutil.which("rosmaster") and Path("/usr/lib/rosout/rosout").exists(),
        "roslaunch, rosmaster or rosout is not installed (Debian's python3-roslaunch)",
    ),
]

MANIFEST = """<package format="2"><name>my_robot</name><version>0.1.0</version><description>.</description>
<maintainer email="a@example.com">a</maintainer><license>MIT</license></package>"""
NODE = """#!/usr/bin/env python3
import os, sys, time, xmlrpc.client
import rosgraph  # is there in ROS's own Python only
uri = os.environ["ROS_MASTER_URI"]
master = xmlrpc.client.ServerProxy(uri)
names = [name for name in master.getParamNames("/node")[2] if name in ("/shared", "/node/speed")]
print("PARAMETERS", sorted((name, master.getParam("/node", name)[2]) for name in names))
print("VARIABLES", uri, os.environ["ROS_HOSTNAME"], os.environ.get("GREETING"), os.environ["HOME"])
print("ARGUMENTS", sys.argv[1:2], flush=True)
master.setParam("/node", "/visited_by_" + os.environ["ROLE"], True)
while "AWAITS" in os.environ and not master.hasParam("/node", "/visited_by_" + os.environ["AWAITS"])[2]:
    time.sleep(0.1)
"""
LAUNCH = """<launch>
  <arg name="speed" default="0.5"/>
  <param name="shared" value="of the $(env ROLE)"/>
  <node pkg="my_robot" type="node.py" name="node" output="screen" required="true" args="$(find my_robot)/map.yaml">
    <param name="speed" value="$(arg speed)"/>
  </node>
</launch>"""

WAITS = '<node pkg="my_robot" type="node.py" name="node"><env name="AWAITS" value="nobody"/></node>'
"""A node beside those that cannot be launched: `roslaunch` goes on for it."""
FAILING = {
    "executable": (
        '<node pkg="my_robot" type="gone.py" name="gone"/>',
        "failed in its launch: cannot launch node of type [my_robot/gone.py]: ",
    ),
    "package": (
        '<node pkg="no_such_robot" type="gone.py" name="gone"/>',
        "failed in its launch: cannot launch node of type [no_such_robot/gone.py]: ",
    ),
    "required": (
        '<node pkg="my_robot" type="dies.py" name="dies" required="true"/>',
        "has died! process has died [pid ",
    ),
    "found": ('<param name="map" value="$(find no_such_robot)"/>', "Resource not found: no_such_robot"),
}
"""Launch files that cannot be launched as they are, and what their jobs say."""

Ending = dict[str, Any]


@pytest.fixture
def launch_config(service: Service, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Makes an application's entry in a request; both applications have the same bundle, a workspace with a package."""
    package = tmp_path / "bundle" / "src" / "my_robot"
    files = {
        "package.xml": MANIFEST, "scripts/node.py": NODE, "launch/drive.launch": LAUNCH,
        "scripts/dies.py": "#!/usr/bin/env python3\nraise SystemExit(3)\n",
        **{f"launch/{name}.launch": f"<launch>{node}{WAITS}</launch>" for name, (node, _) in FAILING.items()},
    }  # fmt: skip
    for name, text in files.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text)
    for script in (package / "scripts").iterdir():
        script.chmod(0o755)
    pack_tar_gz(tmp_path / "bundle", tmp_path / "bundle.tar.gz")
    for bucket in ("applications", "results"):
        service.store.ensure_bucket(bucket)
    service.store.put_file("applications", "ros.tar.gz", tmp_path / "bundle.tar.gz")
    source = {"sources": [{"s3Bucket": "applications", "s3Key": "ros.tar.gz"}]}
    suite = {"name": "ROS", "version": "Melodic"}
    call("CreateRobotApplication", {"name": "robot", "robotSoftwareSuite": suite, **source}, service)
    simulation = {"simulationSoftwareSuite": {"name": "Gazebo", "version": "9"}, "robotSoftwareSuite": suite}
    call("CreateSimulationApplication", {"name": "simulation", **simulation, **source}, service)

    def make(role: str, file: str = "drive.launch", **variables: str) -> dict[str, Any]:
        launch = {"packageName": "my_robot", "launchFile": file, "environmentVariables": {"ROLE": role, **variables}}
        return {"application": role, "launchConfig": launch}

    return make


def ordered(service: Service, *, loggingConfig: dict[str, bool] | None = None, **roles: dict[str, Any]) -> str:  # noqa: N803
    request = {"maxJobDurationInSeconds": 60, "iamRole": ROLE, "outputLocation": {"s3Bucket": "results"}}
    if loggingConfig is not None:
        request |= {"loggingConfig": loggingConfig}
    applications = {f"{role}Applications": [config] for role, config in roles.items()}
    return call("CreateSimulationJob", {**request, **applications}, service)["arn"]


def ended(service: Service, arn: str) -> Ending:
    perform_job(arn, service)
    return call("DescribeSimulationJob", {"job": arn}, service)


def launched(arn: str) -> list[str]:
    """The programs of a job that roslaunch has started."""
    lines = []
    for pid in processes_with(arn):
        with suppress(OSError):  # it has ended meanwhile
            lines.append(Path(f"/proc/{pid}/cmdline").read_bytes().decode())
    return [line for line in lines if "__name:=" in line or "rosmaster" in line]


def said(service: Service, arn: str, role: str) -> dict[str, str]:
    """What the node of an application printed, by its first word."""
    place = service.catalog.get(arn).document["outputs"]
    text = service.store.get_bytes(place["bucket"], f"{place['prefix']}/logs/{role}.stdout.log").decode()
    return dict(line.split(" ", 1) for line in text.splitlines() if line.split(" ")[0].isupper() and " " in line)


def test_nodes_find_their_package_parameters_and_variables(
    service: Service, launch_config: Callable[..., dict[str, Any]]
) -> None:
    arn = ordered(service, robot=launch_config("robot", GREETING="hello"))

    job = ended(service, arn)

    assert job["status"] == "Completed", job
    told = said(service, arn, "robot")
    assert "('/node/speed', 0.5)" in told["PARAMETERS"]
    assert "('/shared', 'of the robot')" in told["PARAMETERS"]
    uri, host, greeting, home = told["VARIABLES"].split()
    assert (uri.rpartition(":")[0], host, greeting) == ("http://localhost", "localhost", "hello")
    assert home.endswith("/home/robomaker")
    assert told["ARGUMENTS"].endswith("/src/my_robot/map.yaml']")


def test_both_applications_share_a_master_and_two_jobs_do_not(
    service: Service, launch_config: Callable[..., dict[str, Any]]
) -> None:
    two = [
        ordered(service, simulation=launch_config("simulation", AWAITS="robot"), robot=launch_config("robot")),
        ordered(service, robot=launch_config("robot")),
    ]

    with ThreadPoolExecutor() as pool:
        assert [job["status"] for job in pool.map(lambda arn: ended(service, arn), two)] == ["Completed"] * 2

    programs = [(two[0], "simulation"), (two[0], "robot"), (two[1], "robot")]
    simulation, robot, alone = (said(service, arn, role)["VARIABLES"].split()[0] for arn, role in programs)
    assert simulation == robot != alone


def test_a_launch_file_that_cannot_be_launched_fails_the_job(
    service: Service, launch_config: Callable[..., dict[str, Any]]
) -> None:
    job = ended(service, ordered(service, robot=launch_config("robot", "missing.launch")))

    assert (job["status"], job["failureCode"]) == ("Failed", "RobotApplicationCrash")
    assert "missing.launch" in job["failureReason"]


def test_a_cancelled_launch_leaves_no_master(service: Service, launch_config: Callable[..., dict[str, Any]]) -> None:
    arn = ordered(service, robot=launch_config("robot", AWAITS="nobody"))
    with ThreadPoolExecutor() as pool:
        performing = pool.submit(perform_job, arn, service)
        wait_for(lambda: len(launched(arn)) == 3, "the master, rosout and the node", 120)
        call("CancelSimulationJob", {"job": arn}, service)
        performing.result()

    assert call("DescribeSimulationJob", {"job": arn}, service)["status"] == "Canceled"
    assert not launched(arn)
    assert not working_below(service.settings.home)


def test_a_launch_file_that_is_not_there_is_the_reason(
    service: Service, launch_config: Callable[..., dict[str, Any]]
) -> None:
    job = ended(service, ordered(service, robot=launch_config("robot", "wrok.launch")))

    assert (job["status"], job["failureCode"]) == ("Failed", "RobotApplicationCrash")
    assert "package my_robot has no launch file wrok.launch; it has drive.launch" in job["failureReason"]


@pytest.mark.parametrize("version", [1, 2])
def test_a_colcon_bundle_is_launched_in_its_overlays(
    version: int, service: Service, launch_config: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    share = "opt/built_workspace/my_robot/share/my_robot"
    setup = {"setup.sh": 'export GREETING="$GREETING from $BUNDLE_CURRENT_PREFIX"\n'}
    node = NODE.replace('get("GREETING")', 'get("GREETING").replace(" ", "|")')
    workspace = {
        **setup, f"{share}/package.xml": MANIFEST, f"{share}/launch/drive.launch": LAUNCH,
        f"{share}/scripts/node.py": node,
    }  # fmt: skip
    output = tmp_path / "output"
    if version == 1:
        bundle_v1(output, workspace)
    else:
        bundle_v2(output, setup, workspace)
    service.store.put_file("applications", "ros.tar.gz", output)  # in the place of the workspace's archive

    arn = ordered(service, robot=launch_config("robot", GREETING="hello"))
    job = ended(service, arn)

    assert job["status"] == "Completed", job
    greeting = said(service, arn, "robot")["VARIABLES"].split()[2]
    names = [place.rpartition("/")[2] for place in greeting.split("|from|")]
    assert names == ["hello", *(["bundle"] if version == 1 else ["dependencies", "workspace"])]


CALLING_NODE = """#!/usr/bin/env python3
import rospy
from robomaker_simulation_msgs.msg import Tag
from robomaker_simulation_msgs.srv import AddTags, Cancel, ListTags, RemoveTags
from std_msgs.msg import String
rospy.init_node("caller")
talk = rospy.Publisher("/spoken", String, queue_size=10, latch=True)
def ask(name, kind, *members):
    rospy.wait_for_service("/robomaker/job/" + name, 120)
    return rospy.ServiceProxy("/robomaker/job/" + name, kind)(*members)
print("ADDED", ask("add_tags", AddTags, [Tag("stage", "driving"), Tag("gone", "x")]).success)
print("REFUSED", ask("add_tags", AddTags, [Tag("aws:no", "x")]).message.replace(chr(10), " "))
print("REMOVED", ask("remove_tags", RemoveTags, ["gone"]).success)
print("TAGS", [(tag.key, tag.value) for tag in ask("list_tags", ListTags).tags])
for number in range(20):
    talk.publish("hello %d" % number)
    rospy.sleep(0.1)
print("CANCEL", ask("cancel", Cancel).success, flush=True)
rospy.spin()
"""
needs_rospy = needs(
    "rospy", Path("/usr/lib/python3/dist-packages/rospy").is_dir() and shutil.which("rosbag"),
    "rospy or rosbag is not installed (Debian's python3-rospy, python3-rosbag)",
)  # fmt: skip


@needs_rospy
def test_nodes_tag_and_cancel_their_job_and_its_topics_are_recorded(
    service: Service, launch_config: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    (tmp_path / "bundle" / "src" / "my_robot" / "scripts" / "node.py").write_text(CALLING_NODE)
    pack_tar_gz(tmp_path / "bundle", tmp_path / "bundle.tar.gz")
    service.store.put_file("applications", "ros.tar.gz", tmp_path / "bundle.tar.gz")
    arn = ordered(service, robot=launch_config("robot"), loggingConfig={"recordAllRosTopics": True})

    job = ended(service, arn)

    assert job["status"] == "Canceled", job
    assert job["tags"] == {"stage": "driving"}
    told = said(service, arn, "robot")
    assert (told["ADDED"], told["REMOVED"], told["CANCEL"]) == ("True", "True", "True")
    assert "aws:no" in told["REFUSED"]
    assert told["TAGS"] == "[('stage', 'driving')]"
    place = service.catalog.get(arn).document["outputs"]
    bag = tmp_path / "topics.bag"
    bag.write_bytes(service.store.get_bytes(place["bucket"], f"{place['prefix']}/ros-topics.bag"))
    with AnyReader([bag]) as reader:
        spoken = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages() if c.topic == "/spoken"]
    assert "hello 19" in [getattr(message, "data", None) for message in spoken]


WHOSE = [("robot",), ("simulation",), ("robot", "simulation"), ("simulation", "robot")]


@pytest.mark.parametrize(
    ("failing", "roles"),
    [
        # Each failure and each place once; all pairs of them by hand.
        pytest.param(failing, roles, marks=() if number == place else pytest.mark.endurance)
        for number, failing in enumerate(FAILING)
        for place, roles in enumerate(WHOSE)
    ],
)
def test_a_launch_that_does_not_launch_all_fails_its_job_with_the_line_that_says_so(
    service: Service, launch_config: Callable[..., dict[str, Any]], failing: str, roles: tuple[str, ...]
) -> None:
    """The first role is the one whose launch fails; the other one would wait for ever."""
    configs = {role: launch_config(role, AWAITS="nobody") for role in roles}
    configs[roles[0]] = launch_config(roles[0], f"{failing}.launch", AWAITS="nobody")

    job = ended(service, ordered(service, **configs))

    assert (job["status"], job["failureCode"]) == ("Failed", f"{roles[0].capitalize()}ApplicationCrash"), job
    assert FAILING[failing][1] in job["failureReason"]
