"""The walker, a built-in robot with four legs, and its trot gait."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mujoco

from ..episode.context import KeepsAttributes
from .drives import VelocityController, VelocityDrive
from .robot import Controller, Lidar, Limits, Robot, add_camera, add_look, add_sensors
from .sensors.imu import Imu
from .sensors.kind import Sensor

Point = tuple[float, float, float]
Angles = tuple[float, float, float]
"""Angles of abduction, hip and knee, in radians."""


@dataclass(frozen=True)
class LegGeometry:
    """Lengths of a walking robot's legs, and where they are attached; metres."""

    hip_x_m: float
    """Forward distance in metres from the body's centre to the abduction joints."""

    hip_y_m: float
    """Sideways distance in metres from the body's centre to the abduction joints."""

    offset_m: float
    """Distance in metres from the abduction joint's axis to the plane in which hip and knee move."""

    thigh_m: float
    shank_m: float
    stance_height_m: float
    """Height in metres of the abduction joints above the centres of the feet."""

    @property
    def hips(self) -> tuple[tuple[float, float], ...]:
        """Positions of the hip joints (x, y) in metres: front left, front right, rear left, rear right."""
        x, y = self.hip_x_m, self.hip_y_m
        return (x, y), (x, -y), (-x, y), (-x, -y)


@dataclass(frozen=True)
class GaitSettings:
    """Step frequency, height and other settings of a trot gait."""

    period_s: float = 0.24
    """Seconds from one step of a foot to its next."""

    stance_share: float = 0.56
    """Fraction of the period that a foot is on the floor; above 0.5, so that at times all four are."""

    lift_m: float = 0.035
    """Height in metres to which feet are lifted."""

    levelling: float = 0.6
    """Fraction of the body's tilt that the legs compensate."""

    placing_s: float = 0.05
    """Distance in metres by which a foot lands farther ahead, per m/s that the body is too fast."""

    speed_gain: float = 0.6
    """Gain of the speed correction: increase of a command per m/s or rad/s that is missing."""


class Motion(NamedTuple):
    """Velocity (m/s, rad/s) of a walking robot's body in its own frame, and its roll and pitch in radians."""

    forward_mps: float
    left_mps: float
    turning_radps: float
    roll_rad: float
    pitch_rad: float


class TrotGait(KeepsAttributes):
    """Trot gait of a four-legged robot: computes the joint angles of all legs, step by step, from velocities."""

    KEPT = ("_phase", "_missing", "_nominal", "_feet", "_lifted_from")

    def __init__(self, legs: LegGeometry, settings: GaitSettings) -> None:
        """Starts the gait with all feet on the floor."""
        self._legs, self._settings = legs, settings
        self.reset()

    def reset(self) -> None:
        """Resets the gait: all feet on the floor."""
        legs = self._legs
        self._phase = 0.0
        self._missing = [0.0, 0.0]
        self._nominal = [(x, y + math.copysign(legs.offset_m, y), -legs.stance_height_m) for x, y in legs.hips]
        self._feet: list[Point] = list(self._nominal)
        self._lifted_from: list[Point | None] = [None] * 4

    def advance(self, dt_s: float, linear: float, angular: float, motion: Motion) -> list[Angles]:
        """Advances the gait by a time step, and returns the joint angles.

        Args:
            dt_s: Time since the last call.
            linear: Commanded forward velocity, m/s.
            angular: Commanded turning rate, rad/s.
            motion: Present velocity of the body.

        Returns:
            Joint angles of the legs, in the order of `LegGeometry.hips`.
        """
        walking = linear != 0.0 or angular != 0.0
        if walking or self._in_the_air():
            self._phase = (self._phase + dt_s / self._settings.period_s) % 1.0
        self._notice(dt_s, linear, angular, motion, walking=walking)
        asked = (linear + self._missing[0], angular + self._missing[1]) if walking else (0.0, 0.0)
        for leg in range(4):
            self._move_foot(leg, dt_s, asked, motion, walking=walking)
        return [self._solve(leg, self._levelled(foot, motion)) for leg, foot in enumerate(self._feet)]

    def _in_the_air(self) -> bool:
        return any(place is not None for place in self._lifted_from)

    def _notice(self, dt_s: float, linear: float, angular: float, motion: Motion, *, walking: bool) -> None:
        """Adapts slowly how much is added to velocity commands (m/s, rad/s), as feet slip and legs yield."""
        errors = (linear - motion.forward_mps, angular - motion.turning_radps)
        limits = (0.5 * abs(linear) + 0.02, 0.5 * abs(angular) + 0.1)
        for axis, (error, limit) in enumerate(zip(errors, limits, strict=True)):
            grown = self._missing[axis] + self._settings.speed_gain * error * dt_s * 2 if walking else 0.0
            self._missing[axis] = max(-limit, min(limit, grown))

    def _move_foot(self, leg: int, dt_s: float, asked: tuple[float, float], motion: Motion, *, walking: bool) -> None:
        settings = self._settings
        phase = (self._phase + (0.0 if leg in (0, 3) else 0.5)) % 1.0
        x, y, z = self._feet[leg]
        if phase < settings.stance_share or (not walking and self._lifted_from[leg] is None):
            self._lifted_from[leg] = None
            # The floor as the body sees it moves backwards and turns the other way.
            vx, vy = -asked[0] + asked[1] * y, -asked[1] * x
            self._feet[leg] = (x + vx * dt_s, y + vy * dt_s, self._nominal[leg][2])
            return
        start = self._lifted_from[leg] or (x, y, z)
        self._lifted_from[leg] = start
        share = (phase - settings.stance_share) / (1 - settings.stance_share)
        end_x, end_y = self._landing(leg, asked, motion)
        blend = share - math.sin(math.tau * share) / math.tau
        lift = settings.lift_m * (1 - math.cos(math.tau * share)) / 2
        self._feet[leg] = (
            start[0] + (end_x - start[0]) * blend,
            start[1] + (end_y - start[1]) * blend,
            self._nominal[leg][2] + lift,
        )

    def _landing(self, leg: int, asked: tuple[float, float], motion: Motion) -> tuple[float, float]:
        """Returns a foot's landing position: half a stance ahead of its rest position; farther if the body drifts.

        It is x and y in the body's frame, in metres.
        """
        x, y, _ = self._nominal[leg]
        half_stand_s = self._settings.period_s * self._settings.stance_share / 2
        vx, vy = asked[0] - asked[1] * y, asked[1] * x
        drift_x, drift_y = motion.forward_mps - asked[0], motion.left_mps
        placing = self._settings.placing_s
        return x + vx * half_stand_s + placing * drift_x, y + vy * half_stand_s + placing * drift_y

    def _levelled(self, foot: Point, motion: Motion) -> Point:
        x, y, z = foot
        share = self._settings.levelling
        return x, y, z + share * (motion.pitch_rad * x - motion.roll_rad * y)

    def _solve(self, leg: int, foot: Point) -> Angles:
        """Computes a leg's three joint angles in radians (abduction, hip, knee) that bring the foot to a position.

        A position beyond the leg's reach is approached as near as it reaches.

        Args:
            leg: Number of the leg.
            foot: Position of the foot in the body's frame, in metres.
        """
        legs = self._legs
        hip_x, hip_y = legs.hips[leg]
        offset = math.copysign(legs.offset_m, hip_y)
        x, y, z = foot[0] - hip_x, foot[1] - hip_y, foot[2]
        down = math.sqrt(max(y * y + z * z - offset * offset, 1e-6))
        abduction = math.atan2(y, -z) - math.atan2(offset, down)
        thigh, shank = legs.thigh_m, legs.shank_m
        reach = min(math.hypot(x, down), 0.995 * (thigh + shank))
        cosine = (reach * reach - thigh * thigh - shank * shank) / (2 * thigh * shank)
        bend = math.acos(max(-0.9, min(1.0, cosine)))
        lean = math.atan2(shank * math.sin(bend), thigh + shank * math.cos(bend))
        # All knees point to the body's middle, where they are in nothing's way.
        inwards = math.copysign(1.0, hip_x)
        return abduction, math.atan2(-x, down) + inwards * lean, -inwards * bend


LEGS = LegGeometry(hip_x_m=0.095, hip_y_m=0.045, offset_m=0.04, thigh_m=0.085, shank_m=0.085, stance_height_m=0.125)
LIMITS = Limits(radius_m=0.185, linear_mps=0.40, angular_radps=1.6, linear_mps2=0.8, angular_radps2=4.0)
LIDAR_HEIGHT_M = 0.20

SUBSTEP_S = 0.01
"""Control period of the gait, in seconds."""

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
"""Friction coefficient of the feet, below that of every floor of a generated world: MuJoCo uses the larger of the two,
so the floor decides.
"""

_DARK = (0.13, 0.14, 0.16, 1.0)
_SHELL = (0.93, 0.94, 0.95, 1.0)
_ACCENT = (0.16, 0.55, 0.85, 1.0)
_RUBBER = (0.06, 0.06, 0.07, 1.0)
_GLASS = (0.05, 0.09, 0.14, 1.0)

_GEOM = mujoco.mjtGeom
_HINGE = mujoco.mjtJoint.mjJNT_HINGE


def build_walker() -> mujoco.MjSpec:
    """Builds the MuJoCo model of the built-in four-legged robot."""
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
    add_sensors(spec, "imu", Imu.parts)
    add_camera(body, "follow", (-0.75, 0, 0.85), (0.72, 0, 0.69))
    add_camera(body, "front", (0.131, 0, 0.01), (0, 0, 1))


@dataclass(frozen=True)
class TrotDrive(VelocityDrive):
    """Drive of a four-legged robot that is controlled by velocity commands."""

    settings: GaitSettings = field(default_factory=GaitSettings)

    def bind(self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> Controller:
        """Returns the controller of the walking robot's legs in a compiled world; see `Drive`."""
        return TrotController(self, model, data, prefix)


class TrotController(VelocityController):
    """Controller that moves the legs of a four-legged robot every 10 ms."""

    KEPT = (*VelocityController.KEPT, "_command")

    substep: Callable[[], None] | None

    def __init__(self, drive: TrotDrive, model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> None:
        """Finds the legs in the compiled model, and sets their controls to stand; see `Drive.bind`."""
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
        """Returns the gait's state for a checkpoint; see `Controller`."""
        return {**super().state(), "gait": self._gait.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores the gait's state from a checkpoint; see `Controller`."""
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
    """Returns the joint angles of the standing robot."""
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
    sensors=[Sensor(Imu, tuple(Imu.parts))],
    video_camera="follow",
)
"""The walker as a robot of the navigation task."""
