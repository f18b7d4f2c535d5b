"""Tree of ROS frames in a recording: poses between frames from `/tf_static` and the newest `/tf`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
"""Transform as a 4 x 4 matrix."""


def matrix_of(position: Any, orientation: Any) -> Matrix | None:
    """Converts a ROS pose to a 4 x 4 matrix; `None` if its numbers are invalid.

    Args:
        position: Position with `x`, `y` and `z`, in metres.
        orientation: Quaternion with `x`, `y`, `z` and `w`.
    """
    numbers = np.array((orientation.w, orientation.x, orientation.y, orientation.z, position.x, position.y, position.z))
    length = float(np.linalg.norm(numbers[:4]))
    if not np.isfinite(numbers).all() or length < 1e-6:  # a quaternion of zeros was never set
        return None
    w, x, y, z = (numbers[:4] / length).tolist()
    return np.array((
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), numbers[4]),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), numbers[5]),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), numbers[6]),
        (0.0, 0.0, 0.0, 1.0),
    ))  # fmt: skip


def quaternion_of(matrix: Matrix) -> list[float]:
    """Converts the orientation of a 4 × 4 transform matrix to a quaternion with w first, as MuJoCo has it."""
    m = matrix
    # By the largest of the four, so that nothing small is divided by: a turn of 180 degrees has w = 0.
    squares = np.array((
        1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2],
        1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2],
    ))  # fmt: skip
    largest = int(np.argmax(squares))
    root = 2 * np.sqrt(max(float(squares[largest]), 1e-12))
    a, b, c = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    d, e, f = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    rows = ((root / 4, a / root, b / root, c / root), (a / root, root / 4, d / root, e / root),
            (b / root, d / root, root / 4, f / root), (c / root, e / root, f / root, root / 4))  # fmt: skip
    return [float(number) for number in rows[largest]]


class FrameTree:
    """Tree of ROS frames (tf), which computes poses between frames."""

    def __init__(self) -> None:
        self.parents: dict[str, str] = {}
        self.is_static: dict[str, bool] = {}
        self._matrices: dict[str, Matrix] = {}

    def copy(self) -> "FrameTree":
        """Returns an independent copy of the tree with the frames that are known now."""
        tree = FrameTree()
        tree.parents, tree.is_static, tree._matrices = dict(self.parents), dict(self.is_static), dict(self._matrices)
        return tree

    def know(self, transform: Any, *, is_static: bool) -> str:
        """Records which frame is the parent of a transform's frame, and returns the latter's name."""
        child = bare(transform.child_frame_id)
        self.parents[child] = bare(transform.header.frame_id)
        self.is_static[child] = is_static
        return child

    def place(self, transform: Any, *, is_static: bool) -> str | None:
        """Records parent and pose of a transform's frame; returns its name, or `None` if the numbers are invalid."""
        child = self.know(transform, is_static=is_static)
        matrix = matrix_of(transform.transform.translation, transform.transform.rotation)
        if matrix is None:
            return None
        self._matrices[child] = matrix
        return child

    def chain(self, root: str, frame: str) -> list[str] | None:
        """Returns the chain of frames from below a root down to a frame; `None` if they are not connected."""
        found: list[str] = []
        while frame != root:
            if frame in found or frame not in self.parents:
                return None
            found.append(frame)
            frame = self.parents[frame]
        return found[::-1]

    def along(self, chain: Sequence[str]) -> Matrix | None:
        """Returns the pose of a chain's last frame as a 4 × 4 matrix in metres; `None` if part of it is unknown."""
        matrix = np.eye(4)
        for frame in chain:
            if frame not in self._matrices:
                return None
            matrix = matrix @ self._matrices[frame]
        return matrix

    def relative(self, base: str, frame: str) -> Matrix | None:
        """Returns the pose of a frame relative to a base frame as a 4 × 4 matrix in metres.

        Returns `None` if the two are not connected, or a pose between them is not known yet.
        """
        above = [base]
        while above[-1] in self.parents and self.parents[above[-1]] not in above:
            above.append(self.parents[above[-1]])
        for root in above:
            down, up = self.chain(root, frame), self.chain(root, base)
            if down is not None and up is not None:
                there, back = self.along(down), self.along(up)
                return None if there is None or back is None else np.linalg.inv(back) @ there
        return None


def bare(frame: str) -> str:
    """Returns a frame's name without the leading slash that old ROS 1 nodes write."""
    return frame.removeprefix("/")
