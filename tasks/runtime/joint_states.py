"""Clock and joint states of environments that record nothing themselves."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from typing import Any

import mujoco
import numpy as np

from . import messages as ros
from .context import Recorder
from .physics import raw_physics

_JOINT_STATE_RATE_HZ = 50.0


class JointStateWatcher:
    """Records `/clock` and `/joint_states` for environments that record nothing themselves."""

    def __init__(self, recorder: Recorder) -> None:
        self.next_time_s = 0.0
        self._recorder = recorder
        self._model: object = None
        self._names: tuple[str, ...] = ()
        self._qpos = self._qvel = np.zeros(0, dtype=np.intp)

    def watch(self, environment: Any, time_s: float) -> None:
        """Records the hinges and slides of the model; effort is the actuators' force on each."""
        model, data = raw_physics(environment.physics)
        if model is not self._model:
            self._prepare(model)
        stamp = ros.Time.from_seconds(time_s)
        self._recorder.write("/clock", ros.Clock(stamp), time_s)
        if self._names:
            message = ros.JointState(
                ros.Header(stamp, ""),
                self._names,
                data.qpos[self._qpos],
                data.qvel[self._qvel],
                data.qfrc_actuator[self._qvel],
            )
            self._recorder.write("/joint_states", message, time_s)
        # From now rather than from the time it was due: control steps may be longer than the interval.
        self.next_time_s = time_s + 1.0 / _JOINT_STATE_RATE_HZ

    def _prepare(self, model: mujoco.MjModel) -> None:
        self._model = model
        simple = np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
        joints = np.flatnonzero(simple)
        self._names = tuple(model.joint(int(j)).name or f"joint_{j}" for j in joints)
        self._qpos = model.jnt_qposadr[joints]
        self._qvel = model.jnt_dofadr[joints]
