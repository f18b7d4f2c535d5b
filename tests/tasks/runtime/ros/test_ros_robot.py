import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.scripted_wire import ScriptedWire

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.schemas.runs.ros_options import KnownTopic, RosOptions, RosPlan
from prefect_robomaker.schemas.wire.base import choices
from prefect_robomaker.schemas.wire.errors import LaunchError
from prefect_robomaker.tasks.runtime.applications.indoor_navigation import make_environment
from prefect_robomaker.tasks.runtime.episode.context import RobotProgramError
from prefect_robomaker.tasks.runtime.recording.cdr import decode
from prefect_robomaker.tasks.runtime.recording.recording import Recorder
from prefect_robomaker.tasks.runtime.ros import ros_robot
from prefect_robomaker.tasks.runtime.ros.bridge_recorder import TOPICS
from prefect_robomaker.tasks.runtime.ros.ros_robot import COMMANDS, RosBridge
from prefect_robomaker.tasks.runtime.ros.wire import Command, Peers


def drive(speed: float, turn: float = 0.0, stamp_s: float | None = None) -> Command:
    return Command((speed, 0.0, 0.0), (0.0, 0.0, turn), stamp_s)


class Run:
    """A run in the flat of two rooms whose nodes are a script."""

    def __init__(self, make_context: Any, wire: ScriptedWire, monkeypatch: pytest.MonkeyPatch, **options: Any) -> None:
        self.wire, self.kept = wire, []
        monkeypatch.setattr(ros_robot, "make_wire", lambda *_: wire)
        plan = SimpleNamespace(ros=RosPlan(suite=2, domain=7, options=RosOptions.model_validate(options)))
        self.bridge = RosBridge(plan, "driver", Recorder(), wire.clock)  # pyright: ignore[reportArgumentType]
        self.environment = make_environment(make_context(recorder=self.bridge.recorder))
        self.bridge.look_in(self.environment)

    def begin(self) -> None:
        while not self.bridge.came():
            self.wire.now_s += 0.1
            assert self.wire.now_s < 60, self.bridge.missing()
        self.agent = self.bridge.make_agent(self.environment, SimpleNamespace(reason=""), self.kept.append)
        self.timestep = self.environment.reset()

    def go(self, steps: int) -> None:
        for _ in range(steps):
            self.timestep = self.environment.step(self.agent(self.timestep))

    def messages(self, topic: str) -> list[Any]:
        return [decode(data, TOPICS[topic].ros_type) for _, name, data in self.wire.sent if name == topic]


@pytest.fixture
def run(make_context: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Run]:
    def make(wire: ScriptedWire | None = None, **options: Any) -> Run:
        return Run(make_context, wire or ScriptedWire(), monkeypatch, **options)

    return make


def notes(made: Run) -> str:
    return "\n".join(made.bridge.close().notes)


def test_a_node_gets_the_state_of_each_step_before_the_scan_and_moves_the_robot(run) -> None:
    hears = Peers(frozenset(TOPICS), commanders=1)
    made = run(ScriptedWire([(2.0, drive(0.3)), (2.5, drive(0.3))], peers=lambda _: hears), time="free")
    made.begin()
    made.go(40)
    clocks = [message.clock.sec + message.clock.nanosec * 1e-9 for message in made.messages("/clock")]
    assert clocks == pytest.approx([0.05 * number for number in range(40)])
    odometry, scans = made.messages("/odom"), made.messages("/scan")
    stamps = [message.header.stamp for message in odometry]
    assert len(scans) == 10
    assert all(scan.header.stamp in stamps for scan in scans)
    order = [topic for _, topic, _ in made.wire.sent]
    for number in [index for index, topic in enumerate(order) if topic == "/scan"]:
        assert {"/clock", "/tf", "/odom"} <= set(order[number - 6 : number])
    assert made.messages("/tf")[-1].transforms[0].child_frame_id == "base_link"
    x, y, _ = made.timestep.observation["pose"]
    assert math.hypot(x, y) > 0.1
    actions = [np.frombuffer(data).tolist() for data in made.kept]
    assert len(actions) == 40
    assert [0.3, 0.0] in actions


def test_states_go_out_where_they_are_heard_and_to_all_in_lockstep(run) -> None:
    def listeners(now_s: float) -> Peers:
        return Peers(frozenset({"/scan"} if now_s < 2.0 else {"/scan", "/odom"}), commanders=1)

    made = run(ScriptedWire(peers=listeners), time="free")
    made.begin()
    made.go(60)
    first = min(at_s for at_s, topic, _ in made.wire.sent if topic == "/odom")
    assert 2.0 <= first < 2.7
    topics = {topic for _, topic, _ in made.wire.sent}
    assert "/clock" in topics
    assert not {"/tf", "/imu", "/joint_states"} & topics
    stepped = run(ScriptedWire([(0.1 * n, drive(0.1)) for n in range(90)], peers=listeners), time="lockstep")
    stepped.begin()
    stepped.go(4)
    assert len(stepped.messages("/odom")) == 4


def test_who_comes_late_learns_where_sensors_are_and_truth_only_where_asked(run) -> None:
    made = run()
    made.begin()
    frames = {each.child_frame_id for each in made.messages("/tf_static")[-1].transforms}
    assert frames == {"base_footprint", "base_scan", "imu_link"}
    assert "/map" not in [topic for _, topic, _ in made.wire.sent]
    hears = Peers(frozenset({"/laser", "/tf"}), commanders=1)
    truth = run(
        ScriptedWire(peers=lambda _: hears),
        localization="truth",
        base_frame="base_footprint",
        topics={"/scan": "/laser", "/imu": None},
    )
    truth.begin()
    truth.go(1)
    names = {topic for _, topic, _ in truth.wire.sent}
    assert {"/map", "/laser"} <= names
    assert not {"/scan", "/imu"} & names
    frames = {each.child_frame_id: each.header.frame_id for each in truth.messages("/tf_static")[-1].transforms}
    assert frames == {"odom": "map", "base_scan": "base_footprint", "imu_link": "base_footprint"}
    assert {topic.name for topic in truth.wire.opened if topic.is_latched} == {
        "/tf_static", "/map", "/robot_description"
    }  # fmt: skip


def test_moving_links_are_told_where_they_are_now(make_context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    walker = ApplicationPlan(
        role="robot", name="walker", attribute="prefect_robomaker.tasks.runtime.applications.walker.make_agent"
    )

    def walking(**members: Any) -> Any:
        context = make_context(**members)
        return replace(context, plan=context.plan.model_copy(update={"robot_application": walker}))

    commands = [(0.05 * number, drive(0.3)) for number in range(100)]
    hears = Peers(frozenset({"/tf"}), commanders=1)
    made = Run(walking, ScriptedWire(commands, peers=lambda _: hears), monkeypatch, time="free")
    made.begin()
    made.go(10)
    told = [each for each in made.messages("/tf") if len(each.transforms) > 1]
    assert len(told) == 10
    frames = {each.child_frame_id: each.transform.rotation for each in told[-1].transforms}
    assert set(frames) == set(made.environment.tf_frames.values()) - {"map"}
    before = {each.child_frame_id: each.transform.rotation for each in told[0].transforms}
    assert sum(str(before[name]) != str(turned) for name, turned in frames.items()) > 4, "its legs move"


def test_a_robot_without_commands_stands_still_after_half_a_second(run) -> None:
    made = run(ScriptedWire([(0.55, drive(0.3, 0.5))]), time="free")
    made.begin()
    made.go(30)
    actions = [np.frombuffer(data).tolist() for data in made.kept]
    moving = [number for number, action in enumerate(actions) if action != [0.0, 0.0]]
    assert len(moving) == 10
    assert "sent 1 command for 30 steps, and none after step 1: the robot stood still" in notes(made)


def test_the_mission_goes_out_as_goals_and_a_place_to_begin(run) -> None:
    made = run()
    made.begin()
    made.go(25)
    assert made.messages("/goal_pose")[0].header.frame_id == "map"
    assert len(made.messages("/goal_pose")) == 2  # again, for those who come up slowly
    assert len(made.messages("/initialpose")) == 2  # each second until the first command
    yaw = made.messages("/initialpose")[0].pose.pose.orientation
    assert 2 * math.atan2(yaw.z, yaw.w) == pytest.approx(made.timestep.observation["pose"][2], abs=0.01)


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_a_command_that_is_no_number_ends_the_run(run, number: float) -> None:
    made = run(ScriptedWire([(0.6, drive(0.1)), (0.8, drive(0.1, number))]), time="free")
    made.begin()
    with pytest.raises(RobotProgramError, match=r"driver sent a command on /cmd_vel .* not finite"):
        made.go(30)


def test_nodes_that_leave_end_the_run(run) -> None:
    wire = ScriptedWire(
        [(0.1 * number, drive(0.1)) for number in range(20)],
        peers=lambda now_s: Peers(frozenset({"/scan"}), commanders=int(now_s < 2.0)),
    )
    made = run(wire)
    made.begin()
    with pytest.raises(StopIteration):
        made.go(1000)
    assert 12.0 <= wire.now_s < 14.0
    said = notes(made)
    assert "all publishers of /cmd_vel had left by" in said
    assert "no node subscribed /clock" in said


def test_nodes_that_never_command_fail_the_run(run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_robot, "_FIRST_COMMAND_S", 4.0)
    wire = ScriptedWire(peers=lambda _: Peers(frozenset({"/scan", "/clock"}), commanders=1))
    made = run(wire, real_time_factor=2.0)
    made.begin()
    with pytest.raises(LaunchError, match=r"no command on /cmd_vel in [0-9.]+ s .* listen to /clock, /scan"):
        made.go(10_000)


@pytest.mark.parametrize("mode", ["lockstep", "paced"])
def test_nodes_without_a_publisher_of_commands_are_told_so_in_each_mode(run, mode: str) -> None:
    made = run(ScriptedWire(peers=lambda _: Peers(frozenset({"/scan", "/odom"}))), time=mode)
    made.begin()
    with pytest.raises(LaunchError) as caught:
        made.go(10_000)
    assert str(caught.value) == (
        "no node of robot application driver publishes geometry_msgs/Twist or TwistStamped on /cmd_vel; of the "
        "simulation's topics the nodes listen to /odom, /scan"
    )
    assert "paced" not in str(caught.value)


def test_a_publisher_of_commands_that_is_not_heard_is_told_in_lockstep(run) -> None:
    peers = Peers(frozenset({"/scan"}), 0, {"/cmd_vel": "best effort geometry_msgs/msg/Twist"})
    made = run(
        ScriptedWire(peers=lambda now_s: peers if now_s > 12.0 else Peers(frozenset({"/scan"}))), time="lockstep"
    )
    made.begin()
    with pytest.raises(
        LaunchError, match=r"; one publishes /cmd_vel with best effort geometry_msgs/msg/Twist; of the simulation"
    ):
        made.go(10_000)


def test_a_program_without_ros_is_not_told_to_follow_the_clock(run) -> None:
    said = []
    for has_ros_nodes in (False, True):
        peers = Peers(frozenset({"/scan"}), 1, has_ros_nodes=has_ros_nodes)
        made = run(ScriptedWire([(0.6, drive(0.1))], peers=lambda _, peers=peers: peers))
        made.begin()
        made.go(20)
        said.append("no node subscribed /clock" in notes(made))
    assert said == [False, True]


def test_nodes_that_listen_may_begin_without_commands(run) -> None:
    wire = ScriptedWire(peers=lambda now_s: Peers(frozenset({"/clock"} if now_s > 1.0 else ())))
    made = run(wire)
    made.begin()
    assert 11.0 <= wire.now_s < 12.0  # some make their publishers when simulated time passes


def test_what_is_missing_is_said(run) -> None:
    wire = ScriptedWire(peers=lambda _: Peers(frozenset({"/scan"}), 0, {"/cmd_vel": "std_msgs/msg/String"}))
    made = run(wire)
    assert not made.bridge.came()
    assert made.bridge.missing() == (
        "or a node has to publish geometry_msgs/Twist or TwistStamped on /cmd_vel in ROS 2, domain 7; found there: "
        "/cmd_vel with std_msgs/msg/String; subscribers of /scan"
    )


def test_two_commanders_and_stamps_of_a_wall_clock_are_said_once(run) -> None:
    commands = [(0.1 * number, drive(0.1, stamp_s=1.7e9)) for number in range(40)]
    made = run(ScriptedWire(commands, peers=lambda _: Peers(frozenset({"/clock"}), commanders=2)))
    made.begin()
    made.go(40)
    found = made.bridge.close()
    assert found.notes == [
        "2 nodes publish /cmd_vel at once: the newest command is taken",
        "commands have stamps of a wall clock: set use_sim_time to true in the nodes",
    ]
    assert found.extra["ros"]["heard"] == ["/clock"]


def test_topics_that_nodes_wait_for_in_vain_are_said(run) -> None:
    hears = Peers(frozenset({"/clock", "/laser", "/camera/image_raw", "/goal_pose"}), commanders=1)
    made = run(
        ScriptedWire([(0.6, drive(0.1)), (0.9, drive(0.1))], peers=lambda _: hears), topics={"/scan": "/laser"},
        goals=True,
    )  # fmt: skip
    made.begin()
    made.go(12)
    assert (
        "nodes subscribed /camera/image_raw, and the simulation published nothing there: the robot has no such sensor, "
        "or its camera could not draw"
    ) in notes(made)


def test_simulations_that_take_no_velocities_are_refused(run) -> None:
    made = run()
    made.bridge.look_in(SimpleNamespace(action_spec=lambda: np.zeros(4)))
    assert not made.bridge.came()
    assert "send velocities, which need actions of two numbers" in made.bridge.missing()


def test_renamed_topics_are_called_by_their_names(run) -> None:
    peers, names = Peers(frozenset({"/time"}), commanders=1), {"/cmd_vel": "/base", "/clock": "/time"}
    made = run(ScriptedWire([(0.6, drive(0.1))], peers=lambda _: peers), topics=names)
    made.begin()
    made.go(30)
    assert "/clock" not in notes(made)
    silent = run(ScriptedWire(peers=lambda _: peers), topics={"/cmd_vel": "/base"})
    silent.begin()
    silent.go(2)
    with pytest.raises(LaunchError, match="sent no command on /base"):
        silent.bridge.close("environment")


def test_options_of_a_robot_are_under_those_that_were_given_also_in_another_process() -> None:
    plan = RosPlan(suite=2, domain=7, options=RosOptions(time="free"))
    arrived = RosPlan.model_validate_json(plan.model_dump_json())
    assert arrived.options.model_fields_set == {"time"}
    assert arrived == plan


@pytest.mark.parametrize(
    ("topics", "said"),
    [
        ({"/cmd_vel": None}, "/cmd_vel is how nodes drive"),
        ({"/scan": "/x", "/odom": "/x"}, "two of them are called /x"),
    ],
)
def test_names_that_cannot_be_are_refused(topics: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        RosOptions.model_validate({"topics": topics})


def test_the_topics_that_can_be_named_are_those_that_there_are() -> None:
    assert set(choices(KnownTopic)) == {*TOPICS, COMMANDS}


def test_a_run_that_ends_without_a_command_is_no_run(run) -> None:
    made = run(ScriptedWire(peers=lambda _: Peers(frozenset({"/scan"}), commanders=1)))
    made.begin()
    made.go(5)
    with pytest.raises(LaunchError, match=r"no command on /cmd_vel in 0\.20 s"):
        made.bridge.close("environment")
    cut = run(ScriptedWire(peers=lambda _: Peers(frozenset({"/scan"}), commanders=1)))
    cut.begin()
    cut.go(5)
    assert cut.bridge.close("canceled").extra["ros"]["commands"] == 0
