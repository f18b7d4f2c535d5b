"""A trot for four legs of three joints each: from (m/s, rad/s) to joint angles.

Feet of diagonal pairs take turns. A foot that stands moves back through the body's frame as the floor does; one that
swings goes in an arc to where its next stand begins. Where that is follows from the commanded and the measured
velocity (Raibert, Legged Robots That Balance, 1986), and what stands is tilted against the body's own tilt.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from ..episode.resumable import KeepsAttributes

Point = tuple[float, float, float]
Angles = tuple[float, float, float]
"""Angles of abduction, hip and knee, in radians."""


@dataclass(frozen=True)
class LegGeometry:
    """Lengths of the legs and where they are joined to the body; metres."""

    hip_x_m: float
    """From the body's middle to the abduction joints, forward."""

    hip_y_m: float
    """Likewise, sideways."""

    offset_m: float
    """From the abduction joint's axis out to the plane that hip and knee move in."""

    thigh_m: float
    shank_m: float
    stance_height_m: float
    """From the feet's middles up to the abduction joints."""

    @property
    def hips(self) -> tuple[tuple[float, float], ...]:
        """Positions of the abduction joints (x, y), in metres: front left, front right, rear left, rear right."""
        x, y = self.hip_x_m, self.hip_y_m
        return (x, y), (x, -y), (-x, y), (-x, -y)


@dataclass(frozen=True)
class GaitSettings:
    """How the legs step."""

    period_s: float = 0.24
    """From one step of a foot to its next."""

    stance_share: float = 0.56
    """Share of the period that a foot is on the floor; above a half, so that at times all four are."""

    lift_m: float = 0.035
    """How high feet are lifted."""

    levelling: float = 0.6
    """Share of the body's tilt that the legs take back."""

    placing_s: float = 0.05
    """How far ahead a foot lands per m/s that the body is too fast."""

    speed_gain: float = 0.6
    """Gain of the speed correction: by how much a command is raised, per m/s or rad/s that is missing."""


class Motion(NamedTuple):
    """Motion of the body, in its own frame."""

    forward_mps: float
    left_mps: float
    turning_radps: float
    roll_rad: float
    pitch_rad: float


class TrotGait(KeepsAttributes):
    """The clock and the feet of one robot."""

    KEPT = ("_phase", "_missing", "_nominal", "_feet", "_lifted_from")

    def __init__(self, legs: LegGeometry, settings: GaitSettings) -> None:
        """Begins standing."""
        self._legs, self._settings = legs, settings
        self.reset()

    def reset(self) -> None:
        """All feet on the floor, below where legs begin."""
        legs = self._legs
        self._phase = 0.0
        self._missing = [0.0, 0.0]
        self._nominal = [(x, y + math.copysign(legs.offset_m, y), -legs.stance_height_m) for x, y in legs.hips]
        self._feet: list[Point] = list(self._nominal)
        self._lifted_from: list[Point | None] = [None] * 4

    def advance(self, dt_s: float, linear: float, angular: float, motion: Motion) -> list[Angles]:
        """Advances the gait by one step.

        Args:
            dt_s: time since the last call.
            linear: commanded forward velocity, m/s.
            angular: commanded turning rate, rad/s.
            motion: what the body does.

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
        """Adapts slowly how much to add to commands: feet slip, and legs yield."""
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
        """Half a stand ahead of the foot's place, and farther the more the body drifts."""
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
        """Angles that bring a foot to a place in the body's frame; as near as the leg reaches."""
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
