"""Judging of ROS recordings: checks and uploads a recording, and makes a specification with one job for it."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

from ...schemas.runs.recording_sources import RECORDED_RUN, SOURCES_VARIABLE, RecordingSources, parse_sources
from ...schemas.runs.requirement_kinds.kind import RequirementKind
from ...schemas.runs.requirements import parse_requirements, rooms_of
from ...schemas.wire.errors import ConfigurationError, ObjectNotFoundError
from ...schemas.wire.json_values import is_mapping
from ..runtime.judging.bags import METADATA, SUFFIXES, Bag, RecordingFault, find_recording
from ..runtime.judging.topic_scene import Measurements
from ..service.service import Service

FOLDER = "recordings"
"""Prefix of the keys of uploaded recordings."""
STORED_AGAIN = timedelta(days=1)
"""Age from which an uploaded recording is uploaded again, so that `gc` does not delete it before a job refers to it."""
_DIGEST_CHARACTERS = 16
_BLOCK_BYTES = 1024 * 1024
_MAX_DURATION_S = 24 * 3600
"""Wall-clock limit of a judging job in seconds; a recording of an hour takes about a minute."""
_ROLE = "arn:aws:iam::000000000000:role/local"
_MEMBERS = ("requirements", "sources")


def asked_of(data: object, place: str) -> tuple[Sequence[RequirementKind], RecordingSources]:
    """Parses a file with requirements, and with the recording topics by which they are measured.

    Args:
        data: Content of the file: a list of requirements, or a mapping with `requirements` and optionally `sources`.
        place: Name of the file, for messages.

    Raises:
        InvalidParameterException: A requirement or a source is invalid; one line per problem.
        ConfigurationError: The file has other content, or no requirement.
    """
    given: Any = data if is_mapping(data) else {"requirements": data}
    if unknown := [name for name in given if name not in _MEMBERS]:
        raise ConfigurationError(f"{place}: {unknown[0]} is not known; {' and '.join(_MEMBERS)} would be right")
    requirements = parse_requirements(given.get("requirements"), f"{place}: requirements")
    if not requirements:
        raise ConfigurationError(
            f"{place} asks for nothing, so there is nothing to judge; a list of requirements would do"
        )
    return requirements, parse_sources(given.get("sources", {}), f"{place}: sources")


def check_recording(place: Path, sources: RecordingSources) -> Path:
    """Finds a ROS recording, and checks by its index whether it can be judged.

    Args:
        place: Path of a file or a folder.
        sources: Topics by which the recording is judged.

    Raises:
        ConfigurationError: The recording cannot be read, is empty or truncated, or lacks a topic that is named.
    """
    try:
        recording = find_recording(place)
        bag = Bag(recording)
        try:
            Measurements(bag, sources)
        finally:
            bag.close()
    except RecordingFault as fault:
        raise ConfigurationError(str(fault)) from fault
    return recording


def check_world(requirements: Sequence[RequirementKind], world: str | None) -> None:
    """Raises an error if requirements need a world and none is given.

    Raises:
        ConfigurationError: A requirement needs a world, and no world is given.
    """
    if world is not None:
        return
    for index, each in enumerate(requirements):
        if each.needs_world:
            raise ConfigurationError(
                f"requirements[{index}] ({each.kind}) needs a world; --world with its ARN would be right"
            )
    for index, room in rooms_of(requirements):
        raise ConfigurationError(
            f"requirements[{index}].room is {room!r}; --world with the ARN of the world that has it would be right, "
            "or a goal as x and y"
        )


def store_recording(recording: Path, service: Service) -> list[str]:
    """Uploads a recording to the service's bucket, unless it was uploaded recently; returns its keys.

    Args:
        recording: Path from `check_recording`.
        service: Service whose object store is used.

    Raises:
        StorageError: The recording cannot be stored.
    """
    files = dict(_files(recording))
    digest = hashlib.sha256()
    for name, path in files.items():
        digest.update(f"{name}\0{path.stat().st_size}\0".encode())
        with path.open("rb") as file:
            while block := file.read(_BLOCK_BYTES):
                digest.update(block)
    prefix = f"{FOLDER}/{digest.hexdigest()[:_DIGEST_CHARACTERS]}"
    keys = {f"{prefix}/{name}": path for name, path in files.items()}
    bucket = service.settings.bucket
    service.store.ensure_bucket(bucket)
    service.store.put_files(bucket, {key: path for key, path in keys.items() if not _is_stored(bucket, key, service)})
    return list(keys)


def judging_spec(
    name: str,
    keys: Sequence[str],
    requirements: Sequence[RequirementKind],
    sources: RecordingSources,
    *,
    bucket: str,
    world: str | None,
) -> str:
    """Makes the specification of a run that judges an uploaded recording.

    Args:
        name: Name of the run.
        keys: Keys from `store_recording`.
        requirements: Requirements on the recorded run.
        sources: Topics by which the recording is judged.
        bucket: Name of the bucket with the recording.
        world: ARN of the world that the robot was in, if it is known.
    """
    application: dict[str, Any] = {"application": RECORDED_RUN, "launchConfig": {}}
    if given := sources.model_dump(mode="json", exclude_defaults=True):
        application["launchConfig"] = {"environmentVariables": {SOURCES_VARIABLE: json.dumps(given)}}
    if world is not None:
        application["worldConfigs"] = [{"world": world}]
    job: Mapping[str, Any] = {
        "maxJobDurationInSeconds": _MAX_DURATION_S,
        "iamRole": _ROLE,
        "simulationApplications": [application],
        "dataSources": [{"name": "recording", "s3Bucket": bucket, "s3Keys": list(keys)}],
        "loggingConfig": {"recordAllRosTopics": False},
        "requirements": [each.to_wire() for each in requirements],
        "seed": 0,
    }
    steps = {"judge": {"operation": "CreateSimulationJob", "input": job}}
    return json.dumps({"version": 1, "name": name, "steps": steps}, indent=2)


def _files(recording: Path) -> Iterator[tuple[str, Path]]:
    """Yields the files of a recording with their names in the object store; other files of the folder are left out."""
    if recording.is_file():
        yield recording.name, recording
        return
    folder = recording.resolve().name
    for path in sorted(recording.iterdir()):
        suffixes = {path.suffix, Path(path.stem).suffix if path.suffix == ".zstd" else path.suffix}
        if path.is_file() and (path.name == METADATA or suffixes & set(SUFFIXES)):
            yield f"{folder}/{path.name}", path


def _is_stored(bucket: str, key: str, service: Service) -> bool:
    """Returns whether an object exists and is recent; its key contains the hash of its content."""
    try:
        stored_at = service.store.head(bucket, key).modified_at
    except ObjectNotFoundError:
        return False
    return stored_at is not None and stored_at > service.clock() - STORED_AGAIN
