"""What the agent asks of its child, and the lines that the child answers with."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from ..deployment import deployment_of
from ..errors import AgentError
from ..states import Checked, Event, Failed, Passed, Phase, State, Trusted


def request(state: State, architecture: str) -> bytes:
    """What the child shall do in a phase that is its own.

    Args:
        state: what the agent remembers.
        architecture: the robot's.
    """
    content: dict[str, Any] = {"phase": state.phase.value, "architecture": architecture}
    if state.phase is Phase.VALIDATING and state.order is not None:
        content.update(order=asdict(state.order), floors=dict(state.floors), newest_s=state.newest_s)
    elif state.deployment is not None:
        content.update(deployment=asdict(state.deployment))
    return json.dumps(content).encode()


def line(**content: Any) -> str:
    """One line of an answer."""
    return json.dumps(content) + "\n"


def events_of(content: Mapping[str, Any], phase: Phase) -> list[Event]:
    """What a line means; nothing if it is progress.

    Raises:
        AgentError: the line is none of a child's.
    """
    try:
        if "trusted" in content:
            return [Trusted(**content["trusted"])]
        if "deployment" in content:
            return [Checked(deployment_of(content["deployment"]))]
        if "failed" in content:
            code, reason = content["failed"]
            return [Failed(phase, code, reason)]
        return [Passed(phase)] if "passed" in content else []
    except (TypeError, KeyError, ValueError) as error:
        raise AgentError(f"a line of the child is not right: {error}") from error
