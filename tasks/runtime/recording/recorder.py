"""The recorder interface: takes ROS 2 messages from environments, agents and observers."""

from collections.abc import Sequence
from typing import Any

from .columns import Series
from .messages import TransformStamped


class Recorder:
    """Takes ROS 2 messages; this one drops them, as of a run that is not recorded."""

    enabled: bool = False
    """Whether anything is written; producers skip making messages when it is not."""
    topics: frozenset[str] = frozenset()
    """Topics that have messages; known when it is closed."""

    def write(self, topic: str, message: Any, time_s: float) -> None:
        """Record a message of `prefect_robomaker.tasks.runtime.recording.messages` at a simulated time."""

    def add_static_transforms(self, transforms: Sequence[TransformStamped], time_s: float) -> None:
        """Record where frames are that do not move, on `/tf_static`, with all that were recorded before."""

    def add_series(self, series: Series) -> None:
        """Record what a series of messages gathers, from now on."""

    def remove_series(self, series: Series) -> None:
        """Write what a series has gathered, and forget the series."""

    def flush_when_due(self, full: bool = False) -> None:
        """Write what has gathered if it is time, or if a series is full."""

    def state(self) -> Any:
        """Write what is pending; return what `restore` needs."""

    def restore(self, state: Any) -> None:
        """Continue from where `state` was taken."""

    def close(self) -> None:
        """Finish the file."""
