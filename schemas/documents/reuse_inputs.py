"""Inputs that decide the result of a simulation job: jobs with the same inputs have the same result."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field

from ..runs.variables import hide_secrets
from ..wire.base import Model
from ..wire.json_values import is_list, is_mapping
from ..wire.request_problems import Location, path_text
from .simulation_jobs import MadeOf, SimulationJobDocument

REUSE_LABEL = "reuseKey"
"""Label of a job in the catalog with the hash of its inputs (reuse key)."""

_MOST_CHANGES = 3
_MOST_CHARACTERS = 40
_ABSENT = "absent"
# How a job is called. Its role is an input: code in the job reads what the role may read.
# Seed, video, requirements and data are inputs of their own, as resolved.
_NOT_INPUTS = ("clientRequestToken", "tags", "seed", "video", "requirements", "dataSources")
# Instead of these names, what they stand for is compared.
_NAMES = ("application", "applicationVersion", "worldConfigs")
_ROLES = ("robotApplications", "simulationApplications")
# Of what is a hash, a person is told only that it is another one.
_CONTENTS = {"world": "the world", "robot": "the robot application", "simulation": "the simulation application"}


class ReuseInputs(Model):
    """All inputs of a simulation job that decide whether an earlier job's results can be reused.

    Only their hash is stored. Nightly reports compare the less exact `JobInputs`.
    """

    request: dict[str, Any] = Field(
        description="Request without names of resources that are compared by their content."
    )
    seed: int = Field(description="Seed of the run's random generators.")
    video: str = Field(description="Video policy: runs of which a video is rendered.")
    requirements: list[dict[str, Any]] = Field(description="Requirements by which the run is judged.")
    data: list[dict[str, Any]] = Field(description="Data sources, with the ETags of their objects.")
    world: str | None = Field(description="Content hash of the world; none: the job has no world.")
    robot: str | None = Field(description="Content of the robot application (ETag or hash); none: the job has none.")
    simulation: str | None = Field(
        description="Content of the simulation application (ETag or hash); none: the job has none."
    )
    versions: dict[str, str] = Field(description="Versions of the packages that run the simulation.")

    @classmethod
    def of(cls, document: SimulationJobDocument, made_of: MadeOf) -> "ReuseInputs":
        """Collects the inputs of a simulation job.

        Args:
            document: The job.
            made_of: Contents of the job's world and applications.
        """
        return cls(
            request=_compared(document.request),
            seed=document.seed,
            video=document.video,
            requirements=document.requirements,
            data=[source.to_json() for source in document.data_sources or []],
            world=made_of.world,
            robot=made_of.robot,
            simulation=made_of.simulation,
            versions=made_of.versions,
        )

    @property
    def key(self) -> str:
        """SHA-256 of all inputs, in hexadecimal: jobs with equal keys can share results.

        The order of members has no effect.
        """
        canonical = json.dumps(self.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(canonical.encode()).hexdigest()

    def changes_since(self, earlier: "ReuseInputs") -> list[str]:
        """Describes how a job's inputs differ from those of an earlier job, one text each, without secrets.

        The list is empty when both have the same key.
        """
        dumped = [inputs.model_dump(mode="json") for inputs in (earlier, self)]
        before, now = (dict(_leaves(inputs, ())) for inputs in dumped)
        paths = [path for path in dict.fromkeys([*before, *now]) if _text(before, path) != _text(now, path)]
        shown = [dict(_leaves(inputs, ())) for inputs in hide_secrets(dumped)]
        return [_change(path, *shown) for path in paths]


def in_short(changes: list[str]) -> str:
    """Joins descriptions of changed inputs into one line: the first ones, then the number of the others."""
    more = len(changes) - _MOST_CHANGES
    return "; ".join([*changes[:_MOST_CHANGES], *([f"and {more} more"] if more > 0 else [])])


def _compared(request: Mapping[str, Any]) -> dict[str, Any]:
    compared = {name: value for name, value in request.items() if name not in _NOT_INPUTS}
    for role in _ROLES:
        if configs := compared.get(role):
            compared[role] = [{name: config[name] for name in config if name not in _NAMES} for config in configs]
    return compared


def _leaves(value: Any, path: Location) -> Iterator[tuple[Location, Any]]:
    """Yields the innermost values with their paths; an empty object or list counts as a value, too."""
    if is_mapping(value) and value:
        for name, inner in value.items():
            yield from _leaves(inner, (*path, name))
    elif is_list(value) and value:
        for index, inner in enumerate(value):
            yield from _leaves(inner, (*path, index))
    else:
        yield path, value


def _text(leaves: Mapping[Location, Any], path: Location) -> str:
    return json.dumps(leaves[path]) if path in leaves else _ABSENT


def _change(path: Location, before: Mapping[Location, Any], now: Mapping[Location, Any]) -> str:
    if path[0] in _CONTENTS:
        return f"{_CONTENTS[str(path[0])]} has changed"
    within = path[1:] if path[0] == "request" else path
    name = path_text(within)
    told = [_text(leaves, path) for leaves in (before, now)]
    if told[0] == told[1]:
        return f"{name}: the secret has changed"
    return f"{name}: {_cut(told[0])} is now {_cut(told[1])}"


def _cut(text: str) -> str:
    return text if len(text) <= _MOST_CHARACTERS else f"{text[: _MOST_CHARACTERS - 1]}…"
