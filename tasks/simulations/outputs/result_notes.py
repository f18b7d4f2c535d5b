"""Lines beside the verdict about what a job asked for and did not get: uploads, requirements, and its bucket."""

from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ....schemas.runs.requested_requirements import REQUIREMENTS_VARIABLE, doubtful_requirements
from ...service.service import Service
from ..environment.run_environment import application_configs
from .upload_configurations import Upload

_NEW_BUCKET = "new-bucket.txt"
_NEAR = 0.8
"""Likeness of two names from which on one may be the other, misspelt."""


def keep_new_bucket(service: Service, bucket: str, folder: Path) -> None:
    """Keeps for later that a job is about to make a bucket of a folder store whose name is nearly that of another.

    Such buckets are made, as programs rely on it.

    Args:
        service: where buckets are.
        bucket: that of the job's outputs.
        folder: the run's own folder.
    """
    place = service.store.local_path(bucket, "any")
    if place is None or place.parent.exists() or not place.parent.parent.is_dir():
        return
    others = [each.name for each in place.parent.parent.iterdir() if each.is_dir() and not each.name.startswith(".")]
    if near := get_close_matches(bucket, others, 1, _NEAR):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _NEW_BUCKET).write_text(f"bucket {bucket} was new; did you mean {near[0]}?")


def notes_of(
    request: Mapping[str, Any], folder: Path, uploads: Sequence[Upload], matched: Collection[int]
) -> list[str]:
    """The lines about a run.

    Args:
        request: the job's request.
        folder: the run's own folder.
        uploads: the job's upload configurations.
        matched: numbers of those that some file was found for.
    """
    notes = [
        f"upload configuration {upload.name}: no file matched {upload.path}"
        for index, upload in enumerate(uploads)
        if upload.path and index not in matched
    ]
    notes += [
        f"the launch variable {name} means nothing here; did you mean {REQUIREMENTS_VARIABLE}?"
        for _, config in application_configs(request)
        for name in doubtful_requirements((config.get("launchConfig") or {}).get("environmentVariables") or {})
    ]
    kept = folder / _NEW_BUCKET
    return [*notes, kept.read_text()] if kept.is_file() else notes
