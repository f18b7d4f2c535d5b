"""ROS 1 for tests: a master, nodes by Debian's Python, and the message packages that Debian's rospy comes without."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from helpers.made_once import made_once
from helpers.ports import free_port
from helpers.processes import started, wait_for
from helpers.required_programs import needs
from prefect_robomaker.tasks.runtime.ros.ros1_wire import ros1_definition

PYTHON = "/usr/bin/python3"
"""The Python beside Debian's ROS."""
NEEDS_ROS_1 = [
    needs(
        "ros",
        shutil.which("roslaunch") and shutil.which("rosmaster"),
        "roslaunch or rosmaster is not installed (Debian's python3-roslaunch)",
    ),
    needs("rospy", Path("/usr/lib/python3/dist-packages/rospy").is_dir(), "rospy is not installed"),
]
_TYPES = (
    "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/PoseStamped",
    "nav_msgs/msg/OccupancyGrid",
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/LaserScan",
    "tf2_msgs/msg/TFMessage",
)
_MAKE = """
import json, pathlib, sys
from genpy.generator import MsgGenerator
from genpy.generate_initpy import write_modules
folder = pathlib.Path(sys.argv[1])
definitions = json.load(sys.stdin)
for name, text in definitions.items():
    package, kind = name.split("/")
    file = folder / "share" / package / "msg" / (kind + ".msg")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
search = {each.name: [str(each / "msg")] for each in (folder / "share").iterdir()}
for package, places in search.items():
    if package in ("std_msgs", "rosgraph_msgs"):
        continue  # Debian's rospy brings these
    target = folder / "python" / package / "msg"
    files = [str(file) for file in pathlib.Path(places[0]).glob("*.msg")]
    if MsgGenerator().generate_messages(package, files, str(target), search):
        sys.exit(1)
    write_modules(str(target))
    (target.parent / "__init__.py").touch()
"""


def definitions() -> dict[str, str]:
    """Definitions of the message types that robots use, and of those in them, by the name that ROS 1 has for them."""
    found: dict[str, str] = {}
    for ros_type in _TYPES:
        own, *others = ros1_definition(ros_type)[0].split("=" * 80 + "\nMSG: ")
        found[ros_type.replace("/msg/", "/")] = own
        found |= dict(each.split("\n", 1) for each in others)
    return found


@pytest.fixture(scope="session")
def ros1_messages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for `PYTHONPATH` with the packages geometry_msgs, nav_msgs, sensor_msgs and tf2_msgs of ROS 1."""

    def make(folder: Path) -> None:
        argv = [PYTHON, "-c", _MAKE, str(folder)]
        subprocess.run(argv, input=json.dumps(definitions()), text=True, check=True, env={"PATH": os.defpath})

    return made_once(tmp_path_factory, "ros1-messages", make) / "python"


class Ros1:
    """A master, and nodes that find it."""

    def __init__(self, folder: Path, messages: Path) -> None:
        """Begins nothing yet."""
        self.folder = folder
        self.environ = {
            "PATH": os.defpath,
            "HOME": str(folder),
            "PYTHONPATH": str(messages),
            "PYTHONUNBUFFERED": "1",
            "ROS_MASTER_URI": f"http://localhost:{free_port()}",
            "ROS_HOSTNAME": "localhost",
            "ROS_LOG_DIR": str(folder / "log"),
        }

    @contextmanager
    def running(self, name: str, argv: list[str], environ: Mapping[str, str] = {}) -> Iterator["subprocess.Popen[str]"]:
        """A process whose output is in a file of this name."""
        with (
            (self.folder / name).open("w") as output,
            started(["/usr/bin/env", "-i", *_assigned({**self.environ, **environ}), *argv], {}, stdout=output,
                    stderr=subprocess.STDOUT, cwd=self.folder) as process,
        ):  # fmt: skip
            yield process

    @contextmanager
    def master(self, **parameters: object) -> Iterator[None]:
        """The master; parameters are set before nodes can be there."""
        port = self.environ["ROS_MASTER_URI"].rpartition(":")[2]
        with self.running("master", ["/usr/bin/rosmaster", "--core", "-p", port]):
            wait_for(lambda: self.ask("m.getPid()"), "the ROS master")
            for name, value in parameters.items():
                self.ask(f"m.setParam('/{name}', {value!r})")
            yield

    def ask(self, question: str) -> object:
        """The answer of the master, `m`; None while there is none."""
        code = (
            "import json, sys, rosgraph\nm = rosgraph.Master('/test')\n"
            f"try: print(json.dumps({question}))\nexcept Exception: print('null')"
        )
        said = subprocess.run(
            [PYTHON, "-c", code], env=self.environ, capture_output=True, text=True, check=True, timeout=200
        )
        return json.loads(said.stdout)

    @contextmanager
    def node(self, name: str, code: str, environ: Mapping[str, str] = {}) -> Iterator["subprocess.Popen[str]"]:
        """A node of rospy that runs `code`."""
        file = self.folder / f"{name}.py"
        file.write_text(f"import rospy, sys\nrospy.init_node({name!r})\n{code}\n")
        with self.running(f"{name}.log", [PYTHON, str(file)], environ) as process:
            yield process

    def said(self, name: str) -> str:
        """The output of a node, or of another process, so far."""
        return (self.folder / name).read_text(errors="replace")


def _assigned(environ: Mapping[str, str]) -> list[str]:
    return [f"{name}={value}" for name, value in environ.items()]


@pytest.fixture
def ros1(tmp_path: Path, ros1_messages: Path) -> Ros1:
    """ROS 1 of a test: its master is not there yet."""
    (tmp_path / "ros1").mkdir()
    return Ros1(tmp_path / "ros1", ros1_messages)


__all__ = ["NEEDS_ROS_1", "PYTHON", "Ros1", "definitions", "ros1", "ros1_messages"]
