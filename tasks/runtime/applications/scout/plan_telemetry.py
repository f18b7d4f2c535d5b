"""Publishes the planned path and goal of a robot application."""

from .....schemas.worlds.world import Point
from ...recording import messages as ros
from ...recording.display_messages import Path, PoseStamped
from ...recording.recorder import Recorder
from .planner import Path as Points

_EVERY_POINTS = 4
"""Paths are published with fewer points than they are followed with, 20 cm apart."""

_FRAME = "map"


def publish_plan(recorder: Recorder, goal: Point, path: Points, time_s: float) -> None:
    """Write `/goal_pose` and `/plan`, as navigation stacks do, where the run is recorded.

    Args:
        recorder: The run's.
        goal: where to, metres.
        path: points on the way, shape (n, 2).
        time_s: simulated time.
    """
    if not recorder.enabled:
        return
    header = ros.Header(ros.Time.from_seconds(time_s), _FRAME)
    points = [*path[:-1:_EVERY_POINTS].tolist(), path[-1].tolist()]
    poses = [PoseStamped(header, ros.Pose(ros.Vector3(x, y))) for x, y in points]
    recorder.write("/goal_pose", PoseStamped(header, ros.Pose(ros.Vector3(*goal))), time_s)
    recorder.write("/plan", Path(header, poses), time_s)
