"""Scout, the built-in robot: a round differential drive made of primitive shapes.

It is 0.34 m wide and 0.19 m high and weighs 3 kg. Its frame `base_link` is on the floor between the wheels; x points
forward, y left, z up. It could be built in hardware: two velocity-controlled wheels, two slides, a planar lidar, an IMU
and a camera.
"""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import mujoco

from .drives import DifferentialDrive
from .robot import Lidar, Limits, Robot, add_camera, add_look, add_sensors
from .sensors.imu import Imu
from .sensors.kind import Sensor

RADIUS_M = 0.17
"""Radius of Scout's body seen from above, in metres; nothing sticks out of it."""

WHEEL_RADIUS_M = 0.04
TRACK_WIDTH_M = 0.22
"""Distance in metres between the points where the wheels touch the floor."""

LIDAR_HEIGHT_M = 0.13
"""Height of the lidar's plane over the floor, in metres; low enough to see most things on the floor of a home."""

LIDAR = Lidar(LIDAR_HEIGHT_M)
"""Lidar with 360 rays every 0.2 s and a range of 0.06 to 3.5 m, like the LDS-01 of a TurtleBot3."""

MAX_LINEAR_MPS = 0.55
MAX_ANGULAR_RADPS = 2.2

PREFIX = "scout/"
"""Prefix of all names of the robot in a compiled world."""

WHEELS = ("wheel_left", "wheel_right")

_SERVO_GAIN = 0.2
_SERVO_TORQUE_NM = 0.15
"""Torque limit of a wheel in N m. Two wheels push with at most 7.5 N: they stall at furniture instead of climbing it.
"""

_TYRE_FRICTION = 0.6
"""Friction coefficient of the tyres, below that of every floor of a generated world: MuJoCo uses the larger of the two,
so the floor decides.
"""

_BUMPER_SOLREF = (0.06, 1.0)
"""Contact parameters (`solref`) of the body, which yields like a sprung bumper: 70 N when it hits a wall at full speed,
where a stiff body has 200 N.
"""

_DARK = (0.13, 0.14, 0.16, 1.0)
_SHELL = (0.93, 0.94, 0.95, 1.0)
_ACCENT = (0.96, 0.45, 0.10, 1.0)
_RUBBER = (0.06, 0.06, 0.07, 1.0)
_GLASS = (0.05, 0.09, 0.14, 1.0)
_LIGHT = (0.25, 0.85, 0.95, 1.0)

_CYLINDER = mujoco.mjtGeom.mjGEOM_CYLINDER
_BOX = mujoco.mjtGeom.mjGEOM_BOX
_SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE
_CAPSULE = mujoco.mjtGeom.mjGEOM_CAPSULE

_ON_ITS_SIDE = (0.7071067811865476, -0.7071067811865476, 0.0, 0.0)
"""Quaternion that turns a cylinder's axis from z to y."""


def build_scout() -> mujoco.MjSpec:
    """Builds the MuJoCo model of Scout, the built-in wheeled robot.

    Cameras are `front` (the robot's view) and `follow` (over its shoulder, for videos), sensors
    `gyro` (rad/s) and `accelerometer` (m/s²), actuators `wheel_left` and `wheel_right` (rad/s).
    """
    spec = mujoco.MjSpec()
    spec.modelname = "scout"
    base = spec.worldbody.add_body(name="base")
    base.add_freejoint(name="base")
    _add_chassis(base)
    _add_looks(base)
    _add_slides(base)
    for side, name in zip((1, -1), WHEELS, strict=True):
        _add_wheel(spec, base, name, side * TRACK_WIDTH_M / 2)
    _add_sensors(spec, base)
    return spec


def _add_chassis(base: mujoco.MjsBody) -> None:
    """Adds the geoms that collide to the robot's base: a disc with the mass of drive and battery, and the lidar."""
    base.add_geom(
        name="chassis",
        type=_CYLINDER,
        pos=[0, 0, 0.062],
        size=[RADIUS_M, 0.036, 0],
        mass=2.5,
        rgba=_SHELL,
        # Its own softness and slipperiness count in every contact.
        priority=1,
        solref=_BUMPER_SOLREF,
        friction=[0.3, 0.005, 0.0001],
    )
    base.add_geom(name="lidar", type=_CYLINDER, pos=[0, 0, 0.135], size=[0.045, 0.027, 0], mass=0.15, rgba=_DARK)


def _add_looks(base: mujoco.MjsBody) -> None:
    """Adds geoms to the robot's base that are only visible, and do not collide."""
    add_look(base, _CYLINDER, [0, 0, 0.032], [0.1705, 0.007, 0], _DARK)
    add_look(base, _CYLINDER, [0, 0, 0.072], [0.1708, 0.006, 0], _ACCENT)
    add_look(base, _CYLINDER, [0, 0, 0.0985], [0.150, 0.002, 0], _DARK)
    add_look(base, _CYLINDER, [0, 0, 0.1005], [0.118, 0.001, 0], _SHELL)
    add_look(base, _CYLINDER, [0, 0, 0.163], [0.047, 0.004, 0], _ACCENT)
    add_look(base, _CYLINDER, [0, 0, LIDAR_HEIGHT_M], [0.0455, 0.008, 0], _GLASS)
    add_look(base, _CYLINDER, [0, 0, 0.1675], [0.022, 0.0015, 0], _DARK)
    add_look(base, _BOX, [0.150, 0, 0.090], [0.016, 0.055, 0.017], _DARK)
    add_look(base, _BOX, [0.1665, 0, 0.090], [0.001, 0.045, 0.011], _GLASS)
    add_look(base, _SPHERE, [0.1655, 0, 0.090], [0.008, 0, 0], _LIGHT)
    for side in (1, -1):
        add_look(base, _BOX, [0.10, side * 0.075, 0.1008], [0.030, 0.004, 0.0012], _LIGHT)
    add_look(base, _CAPSULE, [-0.11, 0.06, 0.135], [0.003, 0.045, 0], _DARK)
    add_look(base, _SPHERE, [-0.11, 0.06, 0.184], [0.006, 0, 0], _ACCENT)


def _add_slides(base: mujoco.MjsBody) -> None:
    """Adds low-friction slides in front and behind, 1 mm off the floor so that the wheels carry the weight.

    Their `priority` makes their own low friction count on every floor.
    """
    for name, x in (("slide_front", 0.125), ("slide_rear", -0.125)):
        base.add_geom(
            name=name, type=_SPHERE, pos=[x, 0, 0.016], size=[0.015, 0, 0], mass=0.02, rgba=_DARK,
            priority=1, friction=[0.01, 0.005, 0.0001],
        )  # fmt: skip


def _add_wheel(spec: mujoco.MjSpec, base: mujoco.MjsBody, name: str, y: float) -> None:
    """Adds a driven wheel to the base of the robot Scout.

    It touches the floor as a sphere: one contact point, at a known distance from the centre, on any kind of floor. The
    visible tyre is a cylinder.
    """
    wheel = base.add_body(name=name, pos=[0, y, WHEEL_RADIUS_M])
    wheel.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0], armature=0.0005, damping=0.001)
    wheel.add_geom(
        name=name, type=_SPHERE, size=[WHEEL_RADIUS_M, 0, 0], mass=0.15, rgba=[0, 0, 0, 0],
        friction=[_TYRE_FRICTION, 0.005, 0.0001],
    )  # fmt: skip
    _look_wheel(wheel)
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    actuator.set_to_velocity(kv=_SERVO_GAIN)
    actuator.forcelimited = True
    actuator.forcerange = [-_SERVO_TORQUE_NM, _SERVO_TORQUE_NM]


def _look_wheel(wheel: mujoco.MjsBody) -> None:
    seen = {"type": _CYLINDER, "quat": _ON_ITS_SIDE, "contype": 0, "conaffinity": 0, "mass": 0}
    wheel.add_geom(size=[WHEEL_RADIUS_M, 0.012, 0], rgba=_RUBBER, **seen)
    wheel.add_geom(size=[0.024, 0.0125, 0], rgba=_ACCENT, **seen)


def _add_sensors(spec: mujoco.MjSpec, base: mujoco.MjsBody) -> None:
    base.add_site(name="scan", pos=[0, 0, LIDAR_HEIGHT_M], group=5)
    base.add_site(name="imu", pos=[0, 0, 0.06], group=5)
    add_sensors(spec, "imu", Imu.parts)
    add_camera(base, "front", (0.172, 0, 0.09), (-0.08, 0, 1))
    add_camera(base, "follow", (-0.75, 0, 0.95), (0.72, 0, 0.69))


LIMITS = Limits(RADIUS_M, MAX_LINEAR_MPS, MAX_ANGULAR_RADPS)

SCOUT = Robot(
    name="scout",
    build=build_scout,
    base="base",
    free_joint="base",
    limits=LIMITS,
    drive=DifferentialDrive(LIMITS, (WHEELS[0],), (WHEELS[1],), WHEEL_RADIUS_M, TRACK_WIDTH_M),
    joints=WHEELS,
    is_differential=True,
    lidar=LIDAR,
    sensors=[Sensor(Imu, tuple(Imu.parts))],
)
"""Scout as a robot of the navigation task."""
