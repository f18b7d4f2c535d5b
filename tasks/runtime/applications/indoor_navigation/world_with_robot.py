"""Puts a robot into a world's MJCF and compiles both."""

# MuJoCo has no type stubs.
# pyright: reportAttributeAccessIssue=false

import logging
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from dm_control.mujoco import Physics, index, wrapper
from dm_control.mujoco.engine import NamedIndexStructs
from dm_control.rl.control import PhysicsError
from numpy.typing import NDArray

from ...robots.robot import Robot
from ...robots.robot_yaml.model import options_for_world
from ...robots.scout import SCOUT
from .lidar import hide_geoms_from_lidar

_logger = logging.getLogger(__name__)

CONTACT_SAMPLE_STEPS = 5
"""Physics steps between two samples of the contacts: 10 ms, shorter than any collision."""

_SCAN_TILT = 0.1 / 3.5
"""Rise of the lidar's plane per metre of distance while the robot rocks; about 1.6 degrees."""

_DRAWN_GROUPS = 3
"""Number of the first geom group that cameras do not draw."""


class ScenePhysics(Physics):
    """dm_control physics that may call a function several times within one control step, and loads data faster."""

    unseen_group: int | None = None
    """Geom group of the fixed geoms that neither the lidar nor the bumper's sensors can hit."""

    between_substeps: Callable[[], None] | None = None
    """Function to call after every `CONTACT_SAMPLE_STEPS` physics steps and at the end of `step`."""

    @property
    def named(self) -> NamedIndexStructs:
        """Access to model and data by name, built on first use."""
        if self._named is None:
            indexers = index.make_axis_indexers(self.model)
            self._named = NamedIndexStructs(
                model=index.struct_indexer(self.model, "mjmodel", indexers),
                data=index.struct_indexer(self.data, "mjdata", indexers),
            )
        return self._named

    def _reload_from_data(self, data: wrapper.MjData) -> None:
        """Loads new data as dm_control does, but without building the name index, which takes most of the time.

        Frees rendering contexts. A physics error after the reset is logged and not raised.
        """
        self._data, self._named = data, None
        self._warnings = data.warning.number
        self._warnings_before = np.empty_like(self._warnings)
        self._new_warnings = np.empty(len(self._warnings), np.bool_)
        with self._contexts_lock:
            if self._contexts:
                self._free_rendering_contexts()
        try:
            self.after_reset()
        except PhysicsError as error:
            _logger.warning("%s", error)

    def step(self, nstep: int = 1) -> None:
        """Advances the simulation by `nstep` physics steps.

        Calls `between_substeps`, if it is set, after every few steps and at the end.

        Raises:
            PhysicsError: The state became invalid.
        """
        model, data, look = self.model.ptr, self.data.ptr, self.between_substeps
        # What dm_control's `check_invalid_state` does, at a fifth of its cost.
        warnings = data.warning.number
        before = warnings.tobytes()
        while nstep > 0:
            mujoco.mj_step(model, data, min(nstep, CONTACT_SAMPLE_STEPS))
            nstep -= CONTACT_SAMPLE_STEPS
            if look is not None:
                look()
        if warnings.tobytes() != before:
            self._raise(warnings - np.frombuffer(before, warnings.dtype))

    def _raise(self, new_warnings: NDArray[np.int32]) -> None:
        names = [str(mujoco.mjtWarning(int(kind)).name) for kind in np.flatnonzero(new_warnings)]
        raise PhysicsError(f"the state of the physics is invalid; MuJoCo warns of {', '.join(names)}")


def assemble(world_xml: Path, robot: Robot = SCOUT) -> ScenePhysics:
    """Loads a world's MJCF, places a robot at its origin, compiles both, and returns their physics.

    Args:
        world_xml: Path of the world's MJCF; its physics options are used for both.
        robot: Robot to place at the origin.

    Raises:
        ValueError: MuJoCo cannot make a model of it; the message has its reason.
    """
    try:
        model = _compile(world_xml, robot)
    except ValueError as cause:
        raise ValueError(f"{world_xml}: not a world that {robot.name.title()} can be put into: {cause}") from cause
    physics = ScenePhysics.from_model(wrapper.MjModel(model))
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    if robot.lidar is not None:
        physics.unseen_group = hide_geoms_from_lidar(
            physics.model.ptr, physics.data.ptr, robot.lidar.height_m, _SCAN_TILT * robot.lidar.range_max_m
        )
        _hide_from_itself(physics.model.ptr, robot.footprint_id(physics.model.ptr), physics.unseen_group)
    return physics


def _compile(world_xml: Path, robot: Robot) -> mujoco.MjModel:
    world, own = mujoco.MjSpec.from_file(str(world_xml)), robot.build()
    _let_sleep(world)
    for geom in own.geoms:
        if geom.group < _DRAWN_GROUPS:
            geom.group = 0  # leaves a group over for what range sensors do not see
    _raise_slide_priority(own, world)
    if dropped := options_for_world(own, world):
        said = "physics options are those of the world, the robot's own are not used"
        _logger.warning("%s: %s: %s", robot.name, said, ", ".join(dropped))
    world.worldbody.add_frame().attach_body(own.body(robot.base), robot.prefix, "")
    return world.compile()


def _raise_slide_priority(own: mujoco.MjSpec, world: mujoco.MjSpec) -> None:
    """Raises the contact priority of robot parts that have one (slides) above that of the world's floors, in place."""
    most = max((geom.priority for geom in world.geoms), default=0)
    for geom in own.geoms:
        if geom.priority > 0:
            geom.priority += max(most, 0)


def _let_sleep(world: mujoco.MjSpec) -> None:
    """Lets loose objects and doors sleep until something touches them, which makes steps ten times faster.

    Does nothing if the world's file sets the option already, as files of earlier generators do. Newer files do not, as
    older versions of MuJoCo could not read it there.
    """
    if world.option.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP.value:
        return
    world.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP.value
    for body in world.worldbody.bodies:
        body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_INIT


def _hide_from_itself(model: mujoco.MjModel, body_id: int, unseen_group: int | None) -> None:
    """Makes the robot's own parts invisible for its range sensors, but not for cameras, by changing the model.

    Parts that are drawn get the unseen geom group, if there is one; parts in undrawn groups become transparent.
    """
    own = model.body_rootid[model.geom_bodyid] == model.body_rootid[body_id]
    if unseen_group is not None:
        model.geom_group[own & (model.geom_group < _DRAWN_GROUPS)] = unseen_group
    # Shapes for collisions only, which cameras leave out: rays go through what is wholly transparent.
    hidden = own & (model.geom_group >= _DRAWN_GROUPS)
    model.geom_matid[hidden] = -1
    model.geom_rgba[hidden, 3] = 0.0
