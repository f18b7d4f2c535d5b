"""Whether an environment that says it records itself did so: nothing else records its clock and joints then."""

from typing import Any

from ..episode.results import Findings
from ..recording.recording import McapRecorder, NullRecorder
from ..video.camera_recorder import INFO_TOPIC, TOPIC

_OF_THE_CAMERA = {TOPIC, INFO_TOPIC, "/tf_static"}
"""Topics that a run writes for an environment; a camera that moves has `/tf` too, which may be the environment's."""


class OwnRecording:
    """Remembers whether the environment of a run says that it records itself."""

    def __init__(self, recorder: McapRecorder | NullRecorder) -> None:
        self._recorder = recorder
        self._is_promised = False

    def look_at(self, environment: Any) -> Any:
        """Looks at an environment that was made; returns it."""
        self._is_promised = bool(getattr(environment, "records_itself", False))
        return environment

    def findings(self) -> Findings:
        """A note where it promised to record and did not; asked when the recording is closed."""
        recorder = self._recorder
        if not self._is_promised or not isinstance(recorder, McapRecorder) or recorder.topics - _OF_THE_CAMERA:
            return Findings()
        return Findings(notes=["the environment says records_itself, and wrote nothing to the recording"])
