"""The recorder interface: takes ROS 2 messages from environments, agents and observers."""

from collections.abc import Sequence
from typing import Any, Protocol

from .columns import Series
from .messages import TransformStamped


class Recorder(Protocol):
    """Takes ROS 2 messages; does nothing when recording is off."""

    enabled: bool
    """Whether anything is written; producers skip making messages when it is not."""

    def write(self, topic: str, message: Any, time_s: float) -> None:
        """Records a message of `prefect_robomaker.tasks.runtime.recording.messages` at a simulated time."""
        ...

    def add_static_transforms(self, transforms: Sequence[TransformStamped], time_s: float) -> None:
        """Records where frames are that do not move, on `/tf_static`, with all that were recorded before."""
        ...

    def add_series(self, series: Series) -> None:
        """Records what a series of messages gathers, from now on."""
        ...

    def remove_series(self, series: Series) -> None:
        """Writes what a series has gathered and forgets it."""
        ...

    def flush_when_due(self, full: bool = False) -> None:
        """Writes what has gathered if it is time, or if a series is full."""
        ...
