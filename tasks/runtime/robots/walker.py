"""The built-in walker: a small robot dog of primitive shapes that trots.

It is 0.25 m long, 0.2 m wide over its feet, 0.21 m high with its lidar, and weighs 2.9 kg. Twelve position-controlled
joints carry it. Its frame is that of the body's middle, x forward, z up.

It is not one of dm_control's own walkers because those are not made for flats: the Ant's legs reach a metre from its
middle while doors are 0.9 m wide, and the others have no gait without a trained policy.
"""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import mujoco

from .drives import VelocityController, VelocityDrive
from .robot import Controller, Lidar, Limits, Robot, add_camera, add_imu, add_look
from .walker_gait import GaitSettings, LegGeometry, Motion, TrotGait

LEGS = LegGeometry(hip_x_m=0.095, hip_y_m=0.045, offset_m=0.04, thigh_m=0.085, shank_m=0.085, stance_height_m=0.125)
LIMITS = Limits(radius_m=0.185, linear_mps=0.40, angular_radps=1.6, linear_mps2=0.8, angular_radps2=4.0)
LIDAR_HEIGHT_M = 0.20

SUBSTEP_S = 0.01
"""The gait's own control period."""

_FOOT_RADIUS_M = 0.014
BODY_HEIGHT_M = LEGS.stance_height_m + _FOOT_RADIUS_M
"""Height of the body's middle over the floor while the robot is standing, in metres."""

LEG_NAMES = ("front_left", "front_right", "rear_left", "rear_right")
_PARTS = ("abduction", "hip", "knee")
JOINTS = tuple(f"{leg}_{part}" for leg in LEG_NAMES for part in _PARTS)

_GAIN_NM = 30.0
_DAMPING_NMS = 0.6
_TORQUE_NM = 4.0

_SOLE_FRICTION = 0.6
"""Below that of every floor of a generated world: MuJoCo takes the larger of the two, so the floor decides."""

_DARK = (0.13, 0.14, 0.16, 1.0)
_SHELL = (0.93, 0.94, 0.95, 1.0)
_ACCENT = (0.16, 0.55, 0.85, 1.0)
_RUBBER = (0.06, 0.06, 0.07, 1.0)
_GLASS = (0.05, 0.09, 0.14, 1.0)

_GEOM = mujoco.mjtGeom
_HINGE = mujoco.mjtJoint.mjJNT_HINGE


def build_walker() -> mujoco.MjSpec:
    """Returns the robot's model with root body `body`; actuators and joints are called `<leg>_<part>`."""
    spec = mujoco.MjSpec()
    spec.modelname = "walker"
    spec.compiler.degree = False
    body = spec.worldbody.add_body(name="body")
    body.add_freejoint(name="body")
    _add_trunk(body)
    for name, (x, y) in zip(LEG_NAMES, LEGS.hips, strict=True):
        _add_leg(spec, body, name, x, y)
    body.add_body(name="footprint", pos=[0, 0, -BODY_HEIGHT_M])
    _add_sensors(spec, body)
    return spec


def _add_trunk(body: mujoco.MjsBody) -> None:
    # The box inside is what collides and weighs; it yields a little, like Scout's bumper.
    body.add_geom(
        name="trunk", type=_GEOM.mjGEOM_BOX, pos=[0, 0, 0.005], size=[0.125, 0.042, 0.030], mass=2.0, rgba=_SHELL,
        priority=1, solref=[0.04, 1.0], friction=[0.3, 0.005, 0.0001],
    )  # fmt: skip
    body.add_geom(
        name="lidar", type=_GEOM.mjGEOM_CYLINDER, pos=[0, 0, 0.055], size=[0.032, 0.020, 0], mass=0.1, rgba=_DARK
    )
    add_look(body, _GEOM.mjGEOM_CYLINDER, [0, 0, LIDAR_HEIGHT_M - BODY_HEIGHT_M], [0.0325, 0.006, 0], _GLASS)
    add_look(body, _GEOM.mjGEOM_BOX, [0, 0, 0.036], [0.100, 0.030, 0.002], _ACCENT)
    add_look(body, _GEOM.mjGEOM_BOX, [0.126, 0, 0.010], [0.004, 0.030, 0.016], _GLASS)
    for side in (1, -1):
        add_look(body, _GEOM.mjGEOM_BOX, [0, side * 0.043, 0.005], [0.110, 0.001, 0.006], _ACCENT)


def _add_leg(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, x: float, y: float) -> None:
    outwards = math.copysign(LEGS.offset_m, y)
    hip = body.add_body(name=f"{name}_abduction", pos=[x, y, 0])
    hip.add_geom(type=_GEOM.mjGEOM_SPHERE, size=[0.020, 0, 0], mass=0.06, rgba=_DARK, contype=0, conaffinity=0)
    hip.add_geom(
        type=_GEOM.mjGEOM_CAPSULE, fromto=[0, 0, 0, 0, outwards, 0], size=[0.011, 0, 0], mass=0, rgba=_DARK,
        contype=0, conaffinity=0,
    )  # fmt: skip
    thigh = hip.add_body(name=f"{name}_hip", pos=[0, outwards, 0])
    _limb(thigh, LEGS.thigh_m, 0.013, 0.08, _SHELL)
    shank = thigh.add_body(name=f"{name}_knee", pos=[0, 0, -LEGS.thigh_m])
    _limb(shank, LEGS.shank_m, 0.009, 0.03, _DARK)
    shank.add_geom(
        name=f"{name}_foot", type=_GEOM.mjGEOM_SPHERE, pos=[0, 0, -LEGS.shank_m], size=[_FOOT_RADIUS_M, 0, 0],
        mass=0.02, rgba=_RUBBER, friction=[_SOLE_FRICTION, 0.01, 0.0002],
    )  # fmt: skip
    # Front knees bend backwards, rear knees forwards.
    bending = ((-0.6, 2.0), (-2.6, -0.1)) if x > 0 else ((-2.0, 0.6), (0.1, 2.6))
    limits = ((-0.7, 0.7), *bending)
    for part, axis, limit in zip((hip, thigh, shank), ([1, 0, 0], [0, 1, 0], [0, 1, 0]), limits, strict=True):
        joint = part.add_joint(name=part.name, type=_HINGE, axis=axis, armature=0.004, damping=0.05, range=limit)
        joint.limited = True
        actuator = spec.add_actuator(name=part.name, target=part.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        actuator.set_to_position(kp=_GAIN_NM, kv=_DAMPING_NMS)
        actuator.forcelimited = True
        actuator.forcerange = [-_TORQUE_NM, _TORQUE_NM]


def _limb(body: mujoco.MjsBody, length_m: float, radius_m: float, mass_kg: float, rgba: Sequence[float]) -> None:
    body.add_geom(
        type=_GEOM.mjGEOM_CAPSULE, fromto=[0, 0, 0, 0, 0, -length_m], size=[radius_m, 0, 0], mass=mass_kg, rgba=rgba
    )


def _add_sensors(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
    body.add_site(name="imu", group=5)
    add_imu(spec, "imu")
    add_camera(body, "follow", (-0.75, 0, 0.85), (0.72, 0, 0.69))
    add_camera(body, "front", (0.131, 0, 0.01), (0, 0, 1))


@dataclass(frozen=True)
class TrotDrive(VelocityDrive):
    """Legs that take velocity commands."""

    settings: GaitSettings = field(default_factory=GaitSettings)

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> Controller:
        """See `Drive`."""
        return TrotController(self, model, data, prefix)


class TrotController(VelocityController):
    """Moves the legs every 10 ms."""

    KEPT = (*VelocityController.KEPT, "_command")

    substep: Callable[[], None] | None

    def __init__(self, drive: TrotDrive, model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> None:
        """Looks up the legs; see `Drive.bind`."""
        super().__init__(drive.limits, self._take)
        self._gait = TrotGait(LEGS, drive.settings)
        self.substep = self._substep
        root = model.joint(f"{prefix}body")
        position, velocity = int(root.qposadr[0]), int(root.dofadr[0])
        self._turn = data.qpos[position + 3 : position + 7]
        self._velocity = data.qvel[velocity : velocity + 6]
        self._control = data.ctrl
        self._actuators = [int(model.actuator(f"{prefix}{name}").id) for name in JOINTS]
        self._command = (0.0, 0.0)
        self._substep()

    def state(self) -> dict[str, Any]:
        """See `Controller`."""
        return {**super().state(), "gait": self._gait.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Controller`."""
        super().restore(state)
        self._gait.restore(state["gait"])

    def _take(self, linear: float, angular: float) -> None:
        self._command = (linear, angular)

    def _substep(self) -> None:
        angles = self._gait.advance(SUBSTEP_S, *self._command, self._motion())
        flat = [angle for leg in angles for angle in leg]
        for actuator, angle in zip(self._actuators, flat, strict=True):
            self._control[actuator] = angle

    def _motion(self) -> Motion:
        w, x, y, z = self._turn.tolist()
        vx, vy, _, _, _, turning = self._velocity.tolist()
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        cos, sin = math.cos(yaw), math.sin(yaw)
        return Motion(vx * cos + vy * sin, vy * cos - vx * sin, turning, roll, pitch)


def _standing() -> dict[str, float]:
    """Joint angles with which it stands."""
    gait = TrotGait(LEGS, GaitSettings())
    angles = gait.advance(0.0, 0.0, 0.0, Motion(0.0, 0.0, 0.0, 0.0, 0.0))
    return dict(zip(JOINTS, (angle for leg in angles for angle in leg), strict=True))


WALKER = Robot(
    name="walker",
    build=build_walker,
    base="body",
    free_joint="body",
    footprint="footprint",
    limits=LIMITS,
    drive=TrotDrive(LIMITS),
    joints=JOINTS,
    spawn_height_m=BODY_HEIGHT_M,
    home=_standing(),
    lidar=Lidar(LIDAR_HEIGHT_M),
    proximity_height_m=0.05,
    imu=("gyro", "accelerometer"),
    video_camera="follow",
)
"""The walker, as the navigation task uses it."""
