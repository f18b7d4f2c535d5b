"""Nodes of ROS 1 take the simulation's time from their first moment, unless their launch says otherwise."""

import signal
from pathlib import Path

import pytest
from helpers.processes import wait_for
from helpers.ros1_nodes import NEEDS_ROS_1, Ros1

from prefect_robomaker.tasks.simulations.planning.launch_configurations import with_launch_file

pytestmark = [pytest.mark.deep, *NEEDS_ROS_1]

NODE = """#!/bin/sh
exec /usr/bin/python3 -c "
import os, xmlrpc.client
print('TIME', xmlrpc.client.ServerProxy(os.environ['ROS_MASTER_URI']).getParam('/n', '/use_sim_time')[2], flush=True)"
"""
MANIFEST = """<package format="2"><name>my_robot</name><version>0.1.0</version><description>.</description>
<maintainer email="a@example.com">a</maintainer><license>MIT</license></package>"""


@pytest.mark.parametrize(
    ("parameter", "by_package", "found"),
    [
        ("", False, "True"),
        ("", True, "True"),
        ('<param name="use_sim_time" value="false"/>', False, "False"),
        ('<param name="use_sim_time" value="false"/>', True, "True"),
    ],
)
def test_nodes_find_the_parameter_when_they_begin(ros1: Ros1, parameter: str, by_package: bool, found: str) -> None:
    package = ros1.folder / "my_robot"
    node = f'<node pkg="my_robot" type="quick" name="quick" output="screen" required="true"/>{parameter}'
    files = {"package.xml": MANIFEST, "quick": NODE, "my.launch": f"<launch>{node}</launch>"}
    package.mkdir()
    for name, text in files.items():
        (package / name).write_text(text)
    (package / "quick").chmod(0o755)
    ours = ros1.folder / "use_sim_time.launch"
    ours.write_text('<launch><param name="/use_sim_time" value="true"/></launch>\n')
    own = ("my_robot", "my.launch") if by_package else (str(package / "my.launch"),)
    argv = with_launch_file(("/usr/bin/roslaunch", *own), Path(ours))

    with ros1.running("launch.log", list(argv), {"ROS_PACKAGE_PATH": str(ros1.folder)}) as launch:
        wait_for(lambda: "TIME" in ros1.said("launch.log") or launch.poll() is not None, "the node")
        launch.send_signal(signal.SIGINT)  # its master is in a session of its own, which only it ends
        launch.wait(200)

    assert f"TIME {found}" in ros1.said("launch.log")
