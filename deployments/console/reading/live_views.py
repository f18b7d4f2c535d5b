"""Address of a run's live view on this machine, read from the note of the run's process."""

import json
import re
from pathlib import Path

from ....tasks.runtime.video.video_settings import LIVE_VIEW_FILE
from .notes import note_of

_MOST_BYTES = 1024
_ADDRESS = re.compile(r"http://127\.0\.0\.1:[0-9]{1,5}/")


def live_view_of(run: Path | None) -> str:
    """The address of a run's live view; empty: it has none. No other address is taken.

    Args:
        run: the folder of the run; `None`: it is not on this machine.
    """
    try:
        url = json.loads(note_of(run, LIVE_VIEW_FILE, _MOST_BYTES))["url"]
    except (ValueError, KeyError, TypeError):
        return ""
    return url if isinstance(url, str) and _ADDRESS.fullmatch(url) else ""
