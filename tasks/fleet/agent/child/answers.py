"""The lines that a child answers with, and what they mean."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from ..deployment import deployment_of
from ..errors import AgentError
from ..states import Checked, Event, Failed, Passed, Phase, Trusted


def line(**content: Any) -> str:
    """One line of an answer."""
    return json.dumps(content) + "\n"


def events_of(content: Mapping[str, Any], phase: Phase) -> list[Event]:
    """Parses an answer line of the child into events; a progress line gives none.

    Raises:
        AgentError: the line is none of a child's.
    """
    try:
        events: list[Event] = [Trusted(**content["trusted"])] if "trusted" in content else []
        if "deployment" in content:
            return [*events, Checked(deployment_of(content["deployment"]))]
        if "failed" in content:
            code, reason = content["failed"]
            return [Failed(phase, code, reason)]
        return [*events, Passed(phase)] if "passed" in content else events
    except (TypeError, KeyError, ValueError) as error:
        raise AgentError(f"a line of the child is not right: {error}") from error
