"""A night that waits for disk is told of once, after a while, and only then."""

from dataclasses import dataclass, field

import pytest
from helpers.receivers import Webhook

from prefect_robomaker.schemas.reports.progress import Note, ProgressEvent, StepProgress
from prefect_robomaker.schemas.runs.programs import Wait
from prefect_robomaker.schemas.settings import Settings
from prefect_robomaker.tasks.notifications.notices import LongWaits

WAITS = Note("drive-1 waits: 52 MB are free on the disk of ROBOMAKER_HOME")


@dataclass
class Night:
    """A run, and what came of its events."""

    settings: Settings
    now_s: float = 0.0
    heard: list[ProgressEvent] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.waits = LongWaits("nightly", self.settings, self.heard.append, lambda: self.now_s)

    def goes(self, *steps: tuple[float, Wait | None]) -> None:
        """From second to second: what it waits for, and a note as waits are told."""
        for self.now_s, waits_for in steps:
            self.waits(StepProgress("drive", {}, 4, waits_for=waits_for))
            self.waits(WAITS)


@pytest.fixture
def night(settings: Settings, webhook: Webhook) -> Night:
    return Night(settings.model_copy(update={"notify": (f"json://{webhook.address}/",)}))


def test_a_wait_of_ten_minutes_is_told_once(night: Night, webhook: Webhook) -> None:
    night.goes((2, "disk"), (300, "disk"))
    assert webhook.got == []
    night.goes((602, "disk"), (1202, "disk"))
    (message,) = webhook.got
    assert message["title"] == "nightly: waits for disk"
    assert message["message"].startswith("drive-1 waits: 52 MB are free")
    assert len(night.heard) == 8, "everything is passed on"


def test_a_disk_that_gets_room_again_is_not_told(night: Night, webhook: Webhook) -> None:
    night.goes((2, "disk"), (400, None), (602, "disk"), (900, "slots"), (5000, "slots"))
    assert webhook.got == []


def test_only_who_wants_to_hear_of_failures_is_told(settings: Settings, webhook: Webhook) -> None:
    channel = {"notify": (f"json://{webhook.address}/",), "notify_when": frozenset({"recovery"})}
    Night(settings.model_copy(update=channel)).goes((2, "disk"), (700, "disk"))
    assert webhook.got == []


def test_an_address_that_is_none_is_said_before_anything_runs(settings: Settings) -> None:
    night = Night(settings.model_copy(update={"notify": ("jsn://hunter2@example.org/",)}))
    (note,) = night.heard
    assert isinstance(note, Note)
    assert note.text.startswith("no message can be sent: ")
    assert "hunter2" not in note.text


def test_a_channel_that_is_away_is_said(settings: Settings) -> None:
    night = Night(settings.model_copy(update={"notify": ("json://127.0.0.1:9/",)}))
    night.goes((2, "disk"), (700, "disk"))
    assert isinstance(night.heard[-1], Note)
    assert night.heard[-1].text.startswith("not notified: ")
