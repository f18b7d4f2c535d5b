"""Clock and joint states of environments that record nothing themselves."""

from typing import Any

from ..episode.physics import raw_physics
from ..episode.results import Observer
from ..recording.recorder import Recorder
from ..recording.state_series import STATE_RATE_HZ, StateSeries, hinges_and_slides


class JointStateWatcher(Observer):
    """Records `/clock` and `/joint_states` for environments that record nothing themselves."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._series: StateSeries | None = None

    def watch(self, environment: Any, time_s: float) -> None:
        """Records the hinges and slides of the model; effort is the actuators' force on each."""
        model, data = raw_physics(environment.physics)
        series = self._series
        if series is None or data is not series.data:
            # Environments may make a new model with every episode.
            if series is not None:
                self._recorder.remove_series(series)
            series = self._series = StateSeries(model, data, hinges_and_slides(model).tolist())
            self._recorder.add_series(series)
        series.sample(self._recorder)
        # From now rather than from the time it was due: control steps may be longer than the interval.
        self.next_time_s = time_s + 1.0 / STATE_RATE_HZ
