"""Request to judge a recording, in a module of its own so that the sender need not import the judging libraries."""

from pathlib import Path

from pydantic import Field

from ....schemas.runs.plan import RunPlan
from ....schemas.runs.recording_sources import RecordingSources
from ....schemas.wire.base import Model, optional


class JudgingRequest(Model):
    """Request to judge the recording of a run by its requirements."""

    plan: RunPlan = Field(description="The run, with its requirements and its world.")
    recording: Path = Field(description="The recording.")
    sources: RecordingSources = Field(default=RecordingSources(), description="Topics that it is judged by.")
    losses: dict[str, str] = Field(
        default={}, description="Why topics are not recorded whole, by their names: what is missing proves nothing."
    )
    ended_by: str | None = optional("Cause of the end of the run; absent: it ended by itself.")
