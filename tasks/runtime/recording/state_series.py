"""Series of ROS messages for a recording: clock, transforms, odometry, joint states and scans, encoded in batches."""

# MuJoCo ships no types for its compiled module.
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from collections.abc import Collection, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from .cdr import AnyNumbers, Columns, Numbers, clock, joint_states, odometry, transforms
from .links import Links
from .recording import DEFAULT_FRAMES, Frames, Recorder

STATE_RATE_HZ = 50.0
"""Rate at which states are recorded, if the environment steps as often."""

_MAX_SAMPLES = 1024
_MAX_BYTES = 768 * 1024
"""Limit in bytes of the messages that wait for a chunk."""
_XYZW = (4, 5, 6, 3)
"""Indices of a free joint's quaternion in its positions, in the order of ROS: x, y, z, w."""


class StateSeries:
    """Samples a robot's joints, pose and velocity, and turns them into ROS messages for a recorder.

    | topic | what |
    | --- | --- |
    | `/clock` | simulated time |
    | `/tf` | `odom` to `base_link`, when there is a base, and its links |
    | `/odom` | the same, with velocities as the base sees them |
    | `/joint_states` | hinges and slides, if any: positions, velocities, and the forces of their actuators |

    A sample costs about a microsecond: it is a copy of the state. Messages are made when a chunk is written.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joints: Sequence[int],
        *,
        base: Sequence[int] = (),
        joint_names: Sequence[str] | None = None,
        joint_frame: str = "",
        links: Links | None = None,
        frames: Frames = DEFAULT_FRAMES,
    ) -> None:
        """Prepares a source of state messages, to be passed to `Recorder.add_series`.

        Args:
            model: The model.
            data: State of the model, read at every sample.
            joints: Ids of hinges and slides to record.
            base: Id of the free joint of the robot, or of two slides along the world's axes and a hinge; without it
                `/tf` and `/odom` are not recorded.
            joint_names: Names of the joints in messages; default: their names in the model.
            joint_frame: Frame id of the joint states, usually the robot's base.
            links: Links whose transforms are also recorded on `/tf`, if there is a base.
            frames: Frame names of odometry and base.
        """
        joints = list(joints)
        names = joint_names or [model.joint(joint).name or f"joint_{joint}" for joint in joints]
        self.topics: list[tuple[str, Columns]] = [("/clock", clock())]
        if base:
            self.topics.append(("/tf", transforms([(frames.odometry, frames.base), *(links.frames if links else [])])))
            self.topics.append(("/odom", odometry(frames.odometry, frames.base)))
        if joints:
            self.topics.append(("/joint_states", joint_states(joint_frame, names)))
        self._data = data
        self._links = links
        positions, velocities = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        of_links = model.jnt_qposadr[links.joints if links else []]
        base_positions, base_velocities = _addresses(model, base)
        # Whole stretches of the state are copied, and what is published is picked from them later.
        place, rate = _span(positions, base_positions, of_links), _span(velocities, base_velocities)
        self._qpos, self._qvel, self._force = data.qpos[place], data.qvel[rate], data.qfrc_actuator[rate]
        self._joint_positions, self._joint_velocities = positions - place.start, velocities - rate.start
        self._base_positions, self._base_velocities = base_positions - place.start, base_velocities - rate.start
        self._link_positions = of_links - place.start
        self._motion = {0: None, 1: _free_motion, 3: _planar_motion}[len(base)]
        row_bytes = sum(len(columns.template) for _, columns in self.topics)
        self._capacity = max(1, min(_MAX_SAMPLES, _MAX_BYTES // row_bytes))
        self._times: list[float] = []
        self._samples: tuple[list[bytes], list[bytes], list[bytes]] = ([], [], [])
        """Sampled positions, velocities and forces."""

    def present(self, wanted: Collection[str]) -> tuple[float, list[list[Sequence[float]]]]:
        """Returns the present state: its time, and the numbers of each topic in the form of `take`.

        Args:
            wanted: Topics to compute; others have no numbers.
        """
        values: list[list[Sequence[float]]] = [[] for _ in self.topics]
        place = {topic: number for number, (topic, _) in enumerate(self.topics) if topic in wanted}
        if self._motion is not None and ("/tf" in place or "/odom" in place):
            pose, twist = self._present_motion()
            if "/tf" in place:
                links = self._links.poses(self._qpos[None, self._link_positions]) if self._links else []
                values[place["/tf"]] = [pose, *(link[0].tolist() for link in links)]
            if "/odom" in place:
                values[place["/odom"]] = [pose, twist]
        if "/joint_states" in place:
            values[place["/joint_states"]] = [
                self._qpos[self._joint_positions].tolist(),
                self._qvel[self._joint_velocities].tolist(),
                self._force[self._joint_velocities].tolist(),
            ]
        return self._data.time, values

    def _present_motion(self) -> tuple[Sequence[float], Sequence[float]]:
        positions, velocities = self._qpos[self._base_positions], self._qvel[self._base_velocities]
        if self._motion is not _free_motion:
            assert self._motion is not None
            pose, twist = self._motion(positions[None], velocities[None])
            return pose[0].tolist(), twist[0].tolist()
        # One row by numpy costs ten times as much as by plain numbers, in the same order of the same operations.
        x, y, z, *turn = positions.tolist()
        w, i, j, k = turn
        east, north, up, *rates = velocities.tolist()
        return (x, y, z, i, j, k, w), (*_turned_back((i, j, k, w), (east, north, up)), *rates)

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo data whose state is sampled."""
        return self._data

    def sample(self, recorder: Recorder) -> None:
        """Adds joint positions, velocities, actuator forces and time of the current state to the buffer of the series.

        Args:
            recorder: Recorder that has the series; it writes a chunk when the buffer is full.

        Raises:
            RecordingError: The file cannot be written.
        """
        positions, velocities, forces = self._samples
        positions.append(self._qpos.tobytes())
        velocities.append(self._qvel.tobytes())
        forces.append(self._force.tobytes())
        times = self._times
        times.append(self._data.time)
        recorder.flush_when_due(full=len(times) >= self._capacity)

    def take(self) -> tuple[Numbers, list[list[Numbers]]]:
        """Returns the samples since the last call, and forgets them.

        Returns:
            Times in seconds, shape (samples,); and for each topic its arrays of numbers, each with a row for each time.
        """
        times, self._times = self._times, []
        samples, self._samples = self._samples, ([], [], [])
        # A signal may have interrupted the last sample.
        positions, velocities, forces = (
            np.frombuffer(b"".join(rows[: len(times)])).reshape(len(times), width)
            for rows, width in zip(samples, (len(self._qpos), len(self._qvel), len(self._force)), strict=True)
        )
        values: list[list[Numbers]] = [[]]
        if self._motion is not None:
            pose, twist = self._motion(
                positions.take(self._base_positions, axis=1), velocities.take(self._base_velocities, axis=1)
            )
            links = self._links.poses(positions.take(self._link_positions, axis=1)) if self._links else []
            values += [[pose, *links], [pose, twist]]
        if self._joint_positions.size:
            values.append(
                [
                    positions.take(self._joint_positions, axis=1),
                    velocities.take(self._joint_velocities, axis=1),
                    forces.take(self._joint_velocities, axis=1),
                ]
            )
        return np.array(times), values


def hinges_and_slides(model: mujoco.MjModel) -> NDArray[np.intp]:
    """Returns the ids of the hinge and slide joints, which ROS joint states can contain."""
    return np.flatnonzero(np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)))


def _addresses(model: mujoco.MjModel, base: Sequence[int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Returns the indices of the base's positions and velocities in the state."""
    free = len(base) == 1
    positions = [int(model.jnt_qposadr[joint]) + part for joint in base for part in range(7 if free else 1)]
    velocities = [int(model.jnt_dofadr[joint]) + part for joint in base for part in range(6 if free else 1)]
    return np.array(positions, np.intp), np.array(velocities, np.intp)


def _span(*addresses: NDArray[np.intp]) -> slice:
    """Returns the slice of the state that contains all given indices."""
    numbers = np.concatenate(addresses)
    return slice(int(numbers.min()), int(numbers.max()) + 1) if numbers.size else slice(0, 0)


def _free_motion(positions: Numbers, velocities: Numbers) -> tuple[Numbers, Numbers]:
    """Converts states of a free joint to poses and twists of ROS messages.

    Args:
        positions: Rows of x, y, z in metres and a quaternion, w first.
        velocities: Rows of linear (m/s, world) and angular (rad/s, body) velocities.

    Returns:
        Rows of x, y, z and a quaternion, w last; and rows of linear and angular velocities in the body's frame.
    """
    pose = positions[:, [0, 1, 2, *_XYZW]]
    # MuJoCo has the linear velocity in the world's frame and the angular one in the body's; ROS has both in the body's.
    back = np.stack(_turned_back(pose[:, 3:].T, velocities[:, :3].T), axis=1)
    return pose, np.concatenate((back, velocities[:, 3:]), axis=1)


def _planar_motion(positions: Numbers, velocities: Numbers) -> tuple[Numbers, Numbers]:
    """Converts states of two slides and a hinge (x m, y m, heading rad) to poses and twists of ROS messages."""
    pose, twist = np.zeros((len(positions), 7)), np.zeros((len(positions), 6))
    heading, (east, north, turning) = positions[:, 2], velocities.T
    pose[:, :2], pose[:, 5], pose[:, 6] = positions[:, :2], np.sin(heading / 2), np.cos(heading / 2)
    cos, sin = np.cos(heading), np.sin(heading)
    twist[:, 0], twist[:, 1], twist[:, 5] = east * cos + north * sin, north * cos - east * sin, turning
    return pose, twist


def _turned_back(quaternion: Any, vector: Any) -> Any:
    """Rotates world vectors into frames with given orientations; works for single vectors and for arrays.

    Args:
        quaternion: Orientations x, y, z, w: four numbers or arrays.
        vector: Vectors: three numbers or arrays.

    Returns:
        The rotated vectors: three numbers or arrays.
    """
    x, y, z, w = -quaternion[0], -quaternion[1], -quaternion[2], quaternion[3]
    east, north, up = vector
    across = 2.0 * (y * up - z * north), 2.0 * (z * east - x * up), 2.0 * (x * north - y * east)
    return (
        east + w * across[0] + (y * across[2] - z * across[1]),
        north + w * across[1] + (z * across[0] - x * across[2]),
        up + w * across[2] + (x * across[1] - y * across[0]),
    )


_NO_TIMES = np.zeros(0)
_MAX_ROW_BYTES = 256 * 1024
"""Limit in bytes of the messages that wait for a chunk."""


class RowSeries:
    """Series of one sensor's measurements, which are collected, and become ROS messages when a chunk is written."""

    def __init__(self, topic: str, columns: Columns) -> None:
        """Prepares a source of a sensor's messages, to be passed to `Recorder.add_series`.

        Args:
            topic: Topic name, such as `/scan`.
            columns: Message template, with numbers of one type.
        """
        self.topics: list[tuple[str, Columns]] = [(topic, columns)]
        self._widths = [width for _, width, _ in columns.numbers.values()]
        (kind,) = {kind for _, _, kind in columns.numbers.values()}
        self._dtype: np.dtype[np.floating[Any]] = np.dtype(kind)
        self._capacity = max(1, _MAX_ROW_BYTES // len(columns.template))
        self._times: list[float] = []
        self._rows: list[bytes] = []

    def add(self, recorder: Recorder, time_s: float, numbers: AnyNumbers) -> None:
        """Adds the numbers of one message, with its time, to the buffer of the series.

        Args:
            recorder: Recorder that has the series; it writes a chunk when the buffer is full.
            time_s: Simulated time.
            numbers: All numbers of the message, in the order of its columns.

        Raises:
            ValueError: The measurement has another count of numbers than the series.
            RecordingError: The file cannot be written.
        """
        if len(numbers) != sum(self._widths):
            topic, wanted = self.topics[0][0], sum(self._widths)
            raise ValueError(f"a message on {topic} has {wanted} numbers, so {len(numbers)} are none")
        self._rows.append(numbers.astype(self._dtype, copy=False).tobytes())
        self._times.append(time_s)
        recorder.flush_when_due(full=len(self._times) >= self._capacity)

    def take(self) -> tuple[Numbers, list[list[AnyNumbers]]]:
        """Returns and forgets the measurements since the last call: times in seconds, and numbers, a row per time."""
        if not self._times:  # nodes are served, and so ask, at every step
            return _NO_TIMES, []
        times, self._times = self._times, []
        rows, self._rows = self._rows, []
        found = np.frombuffer(b"".join(rows[: len(times)]), self._dtype).reshape(len(times), sum(self._widths))
        return np.array(times), [np.split(found, np.cumsum(self._widths)[:-1], axis=1)]
