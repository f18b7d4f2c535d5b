"""Where the socket is, and who may put things there."""

import os
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.stop_flags import StopFlag

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.runs.programs import ProgramPlan
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.agents.agent_socket import (
    AGENT_SOCKET,
    ROS1_SOCKET,
    AgentSocket,
    agent_socket_path,
    remove_agent_socket,
)

MakePlan = Callable[..., RunPlan]


def test_is_in_the_work_folder_if_its_path_is_short_enough(make_plan: MakePlan) -> None:
    plan = make_plan(work_dir=Path("/w"))
    assert agent_socket_path(plan) == Path("/w/.robomaker/agent/agent.sock")
    assert not agent_socket_path(plan).parent.exists(), "asking makes nothing"


@pytest.mark.parametrize("name", ["x" * 200, "ö" * 45, "a/" * 50])
def test_long_folders_have_it_elsewhere(make_plan: MakePlan, name: str) -> None:
    plan = make_plan(work_dir=Path("/w") / name)
    path = agent_socket_path(plan)
    assert len(os.fsencode(path)) <= 107
    assert path.parts[1] == "tmp"
    assert path == agent_socket_path(plan)
    others = (make_plan(work_dir=plan.work_dir, run_id="run-2"), make_plan(work_dir=plan.work_dir / "2"))
    assert path not in [agent_socket_path(other) for other in others]


@pytest.mark.parametrize("length", [1, 150])
def test_can_be_connected_to_and_is_gone_afterwards(make_plan: MakePlan, tmp_path: Path, length: int) -> None:
    plan = make_plan(work_dir=tmp_path / ("x" * length))
    plan.work_dir.mkdir()
    listening = AgentSocket(plan)
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(str(listening.path))
    listening.close()
    assert not listening.path.parent.parent.exists()


def test_files_of_a_killed_run_do_not_block_the_next(make_plan: MakePlan, tmp_path: Path) -> None:
    plan = make_plan(work_dir=tmp_path)
    for name in (AGENT_SOCKET, ROS1_SOCKET, AGENT_SOCKET, ROS1_SOCKET):
        AgentSocket(plan, name)._socket.close()
    remove_agent_socket(plan)
    remove_agent_socket(plan)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
@pytest.mark.parametrize("image", [None, "sha256:0"])
def test_another_user_is_refused_unless_a_container_has_the_socket(
    make_plan: MakePlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, image: str | None
) -> None:
    robot = ProgramPlan(name="robot", role="robot", kind="application", argv=["robot"], folder=tmp_path, image_id=image)
    listening = AgentSocket(make_plan(work_dir=tmp_path, programs=[robot]))
    monkeypatch.chdir(listening.path.parent)  # where the other user does not come by the path
    with socket.socket(socket.AF_UNIX) as foreign, socket.socket(socket.AF_UNIX) as own:
        os.seteuid(65534)
        try:
            foreign.connect(listening.path.name)
        finally:
            os.seteuid(0)
        own.connect(listening.path.name)
        foreign.sendall(b"foreign")
        own.sendall(b"own")
        connection = listening.accept(time.monotonic() + 30, StopFlag())
        assert connection is not None
        with connection as accepted:
            assert accepted.recv(100) == (b"foreign" if image else b"own")
        if image is None:
            with pytest.raises(ConnectionResetError):
                foreign.recv(100)
    listening.close()


@pytest.mark.parametrize("kind", ["link", "file"])
def test_a_folder_of_somebody_else_is_not_used(make_plan: MakePlan, tmp_path: Path, kind: str) -> None:
    plan = make_plan(work_dir=tmp_path / ("x" * 150))
    folder = agent_socket_path(plan).parent.parent
    if kind == "link":
        (tmp_path / "elsewhere").mkdir()
        folder.symlink_to(tmp_path / "elsewhere")
    else:
        folder.touch()
    try:
        with pytest.raises(LaunchError, match="is not a folder of this user"):
            AgentSocket(plan)
    finally:
        folder.unlink()


def test_the_end_of_one_socket_leaves_the_other(make_plan: MakePlan, tmp_path: Path) -> None:
    plan = make_plan(work_dir=tmp_path)
    agent, ros1 = AgentSocket(plan), AgentSocket(plan, ROS1_SOCKET)
    agent.close()
    assert ros1.accept_waiting() is None
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(str(ros1.path))
        accepted = ros1.accept_waiting()
        assert accepted is not None
        accepted.close()
    ros1.close()
    assert list(tmp_path.iterdir()) == []
