"""Publishes the planned path and goal of a robot application."""

from .....schemas.worlds.world import Point
from ...recording import messages as ros
from ...recording.display_messages import Path, PoseStamped
from ...recording.recorder import Recorder
from .planner import Path as Points

_EVERY_POINTS = 4
"""Paths are published with fewer points than they are followed with, 20 cm apart."""

_FRAME = "map"


class PlanTelemetry:
    """Writes `/goal_pose` and `/plan`, as navigation stacks do, whenever a way was planned."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def publish(self, goal: Point, path: Points, time_s: float) -> None:
        """Publishes a way.

        Args:
            goal: where to, metres.
            path: points on the way, shape (n, 2).
            time_s: simulated time.
        """
        if not self._recorder.enabled:
            return
        header = ros.Header(ros.Time.from_seconds(time_s), _FRAME)
        points = [*path[:-1:_EVERY_POINTS].tolist(), path[-1].tolist()]
        poses = [PoseStamped(header, ros.Pose(ros.Vector3(x, y))) for x, y in points]
        self._recorder.write("/goal_pose", PoseStamped(header, ros.Pose(ros.Vector3(*goal))), time_s)
        self._recorder.write("/plan", Path(header, poses), time_s)
