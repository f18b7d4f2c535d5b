"""A small robot in files, and a floor to try robots on."""

from pathlib import Path
from typing import Any

import mujoco
from ruamel.yaml import YAML

from prefect_robomaker.schemas.runs.plan import ApplicationPlan
from prefect_robomaker.tasks.runtime.robots.drives import Base, bind_base, take_home_pose
from prefect_robomaker.tasks.runtime.robots.robot import CONTROL_TIMESTEP_S, Controller, Robot

FLOOR = """<mujoco><option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="10"/><worldbody>
<geom name="ground" type="plane" size="0 0 1" friction="0.7 0.005 0.0001"/></worldbody></mujoco>"""

CART = """<mujoco model="cart"><compiler angle="radian"/>
<worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="1 1 1"/>
<body name="chassis" pos="0 0 0.05"><freejoint name="root"/>
<geom type="box" size="0.12 0.08 0.02" mass="2" group="1"/><geom type="box" size="0.12 0.08 0.02" group="3" mass="0"/>
<site name="eye" pos="0 0 0.10"/>
<geom name="knob_front" type="sphere" pos="0.1 0 -0.03" size="0.019" friction="0.01" priority="1"/>
<geom name="knob_rear" type="sphere" pos="-0.1 0 -0.03" size="0.019" friction="0.01" priority="1"/>
<body name="left" pos="0 0.1 0"><joint name="left" axis="0 1 0" armature="0.001"/>
<geom type="sphere" size="0.05"/></body>
<body name="right" pos="0 -0.1 0"><joint name="right" axis="0 -1 0" armature="0.001"/>
<geom type="sphere" size="0.05"/></body>
<body name="arm" pos="0 0 0.03"><joint name="lift" axis="0 -1 0" range="-1 1"/>
<geom type="capsule" fromto="0 0 0 0.06 0 0" size="0.01" mass="0.05"/></body>
</body></worldbody>
<actuator><velocity name="left" joint="left" kv="1"/><velocity name="right" joint="right" kv="1" gear="2"/>
<position name="lift" joint="lift" kp="5" kv="0.2" ctrlrange="-1 1"/></actuator>
<sensor><gyro name="gyro" site="eye"/><accelerometer name="acc" site="eye"/></sensor>
<keyframe><key name="up" qpos="0 0 0.05 1 0 0 0 0 0 0.5"/></keyframe>
</mujoco>"""
"""Its right wheel turns about the opposite axis and has a gear; both must not matter."""

CART_MAPPING: dict[str, Any] = {
    "version": 1,
    "model": "cart.xml",
    "base": "chassis",
    "footprint": {"radius_m": 0.16},
    "spawn": {"height_m": 0.05, "keyframe": "up"},
    "drive": {
        "kind": "differential",
        "left": ["left"],
        "right": ["right"],
        "wheel_radius_m": 0.05,
        "track_width_m": 0.2,
        "max_linear_mps": 0.6,
        "max_angular_radps": 2.0,
    },
    "sensors": {"lidar": {"at": "eye"}, "imu": {"gyro": "gyro", "accelerometer": "acc"}},
}


PLANAR = """<mujoco><worldbody><body name="chassis" pos="0 0 0.1">
<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
<geom type="cylinder" size="0.15 0.05" mass="5"/>
<body name="upper" pos="0 0 0.1"><joint name="turn" axis="0 0 1"/>
<geom type="box" size="0.1 0.1 0.05" mass="3"/></body></body></worldbody>
<actuator><velocity name="x" joint="x" kv="200"/><velocity name="y" joint="y" kv="200"/>
<velocity name="turn" joint="turn" kv="50"/></actuator></mujoco>"""
PLANAR_MAPPING: dict[str, Any] = CART_MAPPING | {
    "footprint": {"radius_m": 0.16},
    "spawn": {"height_m": 0.1},
    "sensors": {"lidar": {"height_m": 0.3}},
    "drive": {
        "kind": "velocity", "frame": "world", "x": "x", "y": "y", "yaw": "turn", "max_linear_mps": 0.8,
        "max_angular_radps": 1.5,
    },
}  # fmt: skip


def write_robot(folder: Path, mapping: dict[str, Any] | str, **files: str) -> ApplicationPlan:
    """An unpacked bundle whose package `my_cart` holds a robot; file names have `_` for their dot."""
    package = folder / "my_cart"
    package.mkdir(parents=True, exist_ok=True)
    for name, text in {"cart_xml": CART, **files}.items():
        (package / ".".join(name.rsplit("_", 1))).write_text(text)
    if isinstance(mapping, str):
        (package / "robot.yaml").write_text(mapping)
    else:
        with (package / "robot.yaml").open("w") as stream:
            YAML(typ="safe", pure=True).dump(mapping, stream)
    return ApplicationPlan(role="robot", name="cart", attribute="my_cart.make_agent", path=folder)


class Stand:
    """A robot on a floor."""

    def __init__(self, robot: Robot, floor: str = FLOOR) -> None:
        spec, own = mujoco.MjSpec.from_string(floor), robot.build()
        own.option.impratio, own.option.cone = spec.option.impratio, spec.option.cone
        own.option.timestep, own.option.integrator = spec.option.timestep, spec.option.integrator
        spec.worldbody.add_frame().attach_body(own.body(robot.base), robot.prefix, "")
        self.robot, self.model = robot, spec.compile()
        self.data = mujoco.MjData(self.model)
        self.base: Base = bind_base(robot, self.model, self.data)
        self.base.place(0.0)
        take_home_pose(robot, self.model, self.data)
        mujoco.mj_forward(self.model, self.data)
        self.controller: Controller = robot.drive.bind(self.model, self.data, robot.prefix)

    def drive(self, action: Any, duration_s: float) -> float:
        """Returns the largest tilt on the way, radians."""
        tilt = 0.0
        for _ in range(round(duration_s / CONTROL_TIMESTEP_S)):
            self.controller.command(action)
            for _ in range(5):
                mujoco.mj_step(self.model, self.data, 5)
                if self.controller.substep is not None:
                    self.controller.substep()
            tilt = max(tilt, self.base.read().tilt)
        return tilt
