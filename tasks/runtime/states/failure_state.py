"""Stores recent physics states during a run, so that the state before a failure can be examined.

MuJoCo resets the simulation when a number is not finite, so that the states before have to be stored in advance.
"""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....schemas.runs.provenance import (
    FAILURE_MODEL_FILE,
    FAILURE_STATE_FILE,
    FAILURE_VECTOR_FILE,
    FailureState,
    JointState,
    PhysicsWarning,
    StrongContact,
)
from ..episode.physics import raw_physics
from ..episode.run_results import Findings, Observer
from .digest import digest_of_model

KEEP_EVERY_S = 0.05
"""Simulated seconds between two stored states; two of them are kept at a time."""

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_MOST = 10
_OF_A_POSITION = (mujoco.mjtWarning.mjWARN_BADQPOS,)
_OF_A_VELOCITY = (mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


class FailureRecorder(Observer):
    """Observer that counts MuJoCo's warnings, and stores the state if the physics breaks."""

    def __init__(self, output_dir: Path, keep_every_s: float = KEEP_EVERY_S) -> None:
        """Prepares to store states before a failure of the physics; none is stored yet.

        Args:
            output_dir: Folder for `failure-state.json`, `failure-state.npy` and `failure-model.mjb`.
            keep_every_s: Simulated seconds between two stored states.
        """
        self._keep_every_s = keep_every_s
        self._output_dir = output_dir
        self._model: mujoco.MjModel | None = None
        self._data: mujoco.MjData | None = None
        self._states: list[NDArray[np.float64]] = []
        self._warned = np.zeros(0, dtype=np.int64)

    def watch(self, environment: Any, time_s: float) -> None:
        """Stores the environment's current state in place of the older of two that are kept.

        A new model of the environment drops both.
        """
        model, data = raw_physics(environment.physics)
        if model is not self._model:
            self._model, self._data = model, data
            self._states = [np.full(mujoco.mj_stateSize(model, _STATE), np.nan) for _ in range(2)]
            self._warned = data.warning.number.copy()
        self._states.reverse()
        mujoco.mj_getState(model, data, self._states[0], _STATE)
        self.next_time_s = time_s + self._keep_every_s

    def restore(self, state: float, environment: Any) -> None:
        """Restores nothing: a resumed run stores its states anew."""

    def close(self, ended_by: str | None) -> Findings:
        """Returns MuJoCo's warnings; writes the stored states if the physics has failed.

        Args:
            ended_by: Cause of the run's end; None if it failed.
        """
        if self._model is None or self._data is None:
            return Findings()
        counts = self._data.warning.number - self._warned
        if ended_by is None:
            kept = next((state for state in self._states if np.isfinite(state).all()), None)
            if kept is not None and (counts.any() or _not_finite(self._data)):
                self._write(self._model, self._data, kept, counts)
            return Findings()
        found = {_warning_name(kind): int(counts[kind]) for kind in np.flatnonzero(counts > 0).tolist()}
        if not found:
            return Findings()
        return Findings(extra={"mujoco_warnings": found}, metrics={"mujoco_warnings": float(sum(found.values()))})

    def explain(self) -> str:
        """Returns text that names the joints whose numbers became non-finite; empty if MuJoCo reported no joint.

        MuJoCo's own message has the index of a degree of freedom, which is hard to understand.
        """
        if self._model is None or self._data is None:
            return ""
        counts = self._data.warning.number - self._warned
        bad = [warning for warning in _warnings(self._model, self._data, counts) if warning.joint is not None]
        return "; ".join(dict.fromkeys(f"bad numbers at joint {item.joint!r} of body {item.body!r}" for item in bad))

    def _write(
        self, model: mujoco.MjModel, data: mujoco.MjData, kept: NDArray[np.float64], counts: NDArray[np.int64]
    ) -> None:
        before = mujoco.MjData(model)
        mujoco.mj_setState(model, before, kept, _STATE)
        mujoco.mj_forward(model, before)
        np.save(self._output_dir / FAILURE_VECTOR_FILE, kept)
        mujoco.mj_saveModel(model, str(self._output_dir / FAILURE_MODEL_FILE))
        warned = [_warned_joint(model, data, kind) for kind in np.flatnonzero(counts > 0).tolist()]
        state = FailureState(
            time_s=before.time,
            step=round(before.time / model.opt.timestep),
            began_anew=bool(data.time < before.time),
            warnings=list(_warnings(model, data, counts)),
            not_finite=_not_finite(data),
            joints=_joints(model, before, [joint for joint in warned if joint is not None]),
            contacts=_contacts(model, before),
            control={_name(model.actuator(i).name, "actuator", i): float(before.ctrl[i]) for i in range(model.nu)},
            model_sha256=digest_of_model(model),
            mujoco=mujoco.__version__,
        )
        (self._output_dir / FAILURE_STATE_FILE).write_text(state.model_dump_json(indent=2) + "\n")


def _warnings(model: mujoco.MjModel, data: mujoco.MjData, counts: NDArray[np.int64]) -> Iterator[PhysicsWarning]:
    for kind in np.flatnonzero(counts > 0).tolist():
        joint = _warned_joint(model, data, kind)
        yield PhysicsWarning(
            warning=_warning_name(kind),
            count=int(counts[kind]),
            text=mujoco.mju_warningText(kind, int(data.warning[kind].lastinfo)),
            joint=None if joint is None else _joint_name(model, joint),
            body=None if joint is None else _body_name(model, int(model.jnt_bodyid[joint])),
        )


def _warned_joint(model: mujoco.MjModel, data: mujoco.MjData, kind: int) -> int | None:
    """Returns the number of the joint that a MuJoCo warning about a bad number refers to; `None` if to none."""
    place = int(data.warning[kind].lastinfo)
    if kind in map(int, _OF_A_VELOCITY) and 0 <= place < model.nv:
        return int(model.dof_jntid[place])
    if kind in map(int, _OF_A_POSITION) and 0 <= place < model.nq:
        return int(np.searchsorted(model.jnt_qposadr, place, side="right")) - 1
    return None


def _joints(model: mujoco.MjModel, data: mujoco.MjData, warned: Iterable[int]) -> list[JointState]:
    fastest = [int(model.dof_jntid[dof]) for dof in np.argsort(-np.abs(data.qvel))]
    states = []
    for joint in list(dict.fromkeys([*warned, *fastest]))[:_MOST]:
        position, velocity = _places(model, joint)
        states.append(
            JointState(
                joint=_joint_name(model, joint),
                body=_body_name(model, int(model.jnt_bodyid[joint])),
                qpos=[_finite(value) for value in data.qpos[position]],
                qvel=[_finite(value) for value in data.qvel[velocity]],
                qacc=[_finite(value) for value in data.qacc[velocity]],
            )
        )
    return states


def _places(model: mujoco.MjModel, joint: int) -> tuple[slice, slice]:
    """Returns the slices of a joint's numbers in positions and in velocities."""
    ends = (*model.jnt_qposadr[joint + 1 : joint + 2].tolist(), model.nq)[0]
    last = (*model.jnt_dofadr[joint + 1 : joint + 2].tolist(), model.nv)[0]
    return slice(int(model.jnt_qposadr[joint]), ends), slice(int(model.jnt_dofadr[joint]), last)


def _contacts(model: mujoco.MjModel, data: mujoco.MjData) -> list[StrongContact]:
    wrench = np.zeros(6)
    forces = []
    for index in range(data.ncon):
        mujoco.mj_contactForce(model, data, index, wrench)
        forces.append(float(wrench[0]))
    strongest = sorted(range(data.ncon), key=lambda index: -abs(forces[index]))[:_MOST]
    return [
        StrongContact(
            first=_geom_name(model, int(data.contact.geom[index, 0])),
            second=_geom_name(model, int(data.contact.geom[index, 1])),
            normal_force_N=_finite(forces[index]),
            depth_m=-float(data.contact.dist[index]),
            position_m=tuple(data.contact.pos[index].tolist()),
        )
        for index in strongest
    ]


def _not_finite(data: mujoco.MjData) -> dict[str, list[int]]:
    found = {name: np.flatnonzero(~np.isfinite(getattr(data, name))).tolist() for name in ("qpos", "qvel", "qacc")}
    return {name: places for name, places in found.items() if places}


def _warning_name(kind: int) -> str:
    return str(mujoco.mjtWarning(kind).name)


def _joint_name(model: mujoco.MjModel, joint: int) -> str:
    return model.joint(joint).name or _body_name(model, int(model.jnt_bodyid[joint]))


def _geom_name(model: mujoco.MjModel, geom: int) -> str:
    return _name(model.geom(geom).name or model.body(int(model.geom_bodyid[geom])).name, "geom", geom)


def _body_name(model: mujoco.MjModel, body: int) -> str:
    return _name(model.body(body).name, "body", body)


def _name(name: str, what: str, number: int) -> str:
    return name or f"{what} {number}"


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
