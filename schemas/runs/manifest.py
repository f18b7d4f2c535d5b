"""Manifest of published outputs: the content of `manifest.json`, which is written last.

A folder of objects without a manifest is not finished, even if objects are there. Readers read what the
manifest names and nothing else.
"""

from typing import Annotated, Literal

from pydantic import AfterValidator, AwareDatetime, Field, JsonValue, model_validator

from ..wire.base import Model


def _inside(path: str) -> str:
    """Refuses paths that could lead out of the folder they are fetched into."""
    if "\0" in path or any(part in ("", ".", "..") for part in path.split("/")):
        raise ValueError(f"{path!r} has to be a relative path without empty, '.' and '..' components")
    return path


class ManifestFile(Model):
    """One published file."""

    path: Annotated[str, AfterValidator(_inside)] = Field(description="Path below the manifest's own folder.")
    size_bytes: int = Field(ge=0, description="Size.")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$", description="SHA-256 of the content, in hexadecimal.")


class Manifest(Model):
    """Files that were published together, and what they are."""

    schema_version: Literal[1] = Field(default=1, description="Version of this document's form.")
    created_at: AwareDatetime = Field(description="When the files were published.")
    about: dict[str, JsonValue] = Field(description="Facts about the origin of the files: job, run, status and so on.")
    files: list[ManifestFile] = Field(description="All files, in the order of their paths.")

    @model_validator(mode="after")
    def _paths_are_unique(self) -> "Manifest":
        paths = [file.path for file in self.files]
        if len(set(paths)) < len(paths):
            twice = sorted({path for path in paths if paths.count(path) > 1})
            raise ValueError(f"files name {', '.join(twice)} more than once")
        return self
