"""Where the socket is, and who may put things there."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.agents.agent_socket import AgentSocket, agent_socket_path, remove_agent_socket

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
    AgentSocket(plan)._socket.close()
    AgentSocket(plan)._socket.close()
    remove_agent_socket(plan)
    remove_agent_socket(plan)
    assert list(tmp_path.iterdir()) == []


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
