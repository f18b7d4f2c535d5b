"""A wire to ROS 1 that listens for its bridge."""

from collections.abc import Callable, Iterator

import pytest
from helpers.ros_samples import COMMANDS, TOPICS

from prefect_robomaker.schemas.runs.plan import RunPlan
from prefect_robomaker.tasks.runtime.agents.agent_socket import ROS1_SOCKET, agent_socket_path
from prefect_robomaker.tasks.runtime.ros.ros1_wire import Ros1Wire

MakePlan = Callable[..., RunPlan]


@pytest.fixture
def wire(make_plan: MakePlan) -> Iterator[Ros1Wire]:
    """A wire that listens for the bridge."""
    plan = make_plan()
    plan.work_dir.mkdir(parents=True)
    made = Ros1Wire(plan)
    made.open(TOPICS, COMMANDS)
    yield made
    made.close()
    assert not agent_socket_path(plan, ROS1_SOCKET).parent.parent.exists()


@pytest.fixture
def socket_path(make_plan: MakePlan) -> str:
    return str(agent_socket_path(make_plan(), ROS1_SOCKET))
