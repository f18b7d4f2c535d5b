"""The path that the robot has driven so far, as a file that others read while the run goes on.

Each line is a moment: simulated time in seconds, and where the robot is, in metres: `12.5,1.25,-0.75`. Lines are only
added; a run that goes on from a checkpoint adds earlier moments again.
"""

import math

PATH_FILE = "driven-path.csv"
"""Name of the file, in the work folder of the run."""

PathPoint = tuple[float, float, float]


def line_of(point: PathPoint) -> str:
    """A moment as the file has it."""
    time_s, x, y = point
    return f"{time_s:.3f},{x:.3f},{y:.3f}\n"


def points_of(text: str) -> list[PathPoint]:
    """The moments of a file, in order; what cannot be read is left out.

    Args:
        text: the file's content, to which the application may have written anything.
    """
    points: list[PathPoint] = []
    for line in text.splitlines(keepends=True):
        try:
            time_s, x, y = map(float, line.split(","))
        except ValueError:
            continue
        if not line.endswith("\n") or not all(map(math.isfinite, (time_s, x, y))):
            continue
        while points and points[-1][0] >= time_s:
            points.pop()
        points.append((time_s, x, y))
    return points
