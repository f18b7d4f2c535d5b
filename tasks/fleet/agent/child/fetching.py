"""Downloads files of the TUF repository to the robot: continues interrupted downloads, and verifies hashes."""

from __future__ import annotations

import hashlib
import http.client
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Callable
from urllib.parse import quote

from ..deployment import File
from ..errors import StepFailed, TryLater, disk_failure
from ..server import connect
from ..settings import Connection

CHUNK_BYTES = 1 << 18
_TIMEOUT_S = 30.0


@dataclass(frozen=True)
class Part:
    """Content of a file that the update server sends: all, or the rest after an interruption."""

    start: int
    """First byte of the content: 0 if the server sends the whole file, although only the rest was requested."""

    chunks: Iterator[bytes]


class HttpStatus(Exception):
    """Raised when the update server answers with an HTTP error status."""

    def __init__(self, status: int) -> None:
        super().__init__(f"HTTP status {status}")
        self.status = status
        """HTTP status of the update server's error."""


Source = Callable[[str, int], Part]
"""Function that reads a repository file (`metadata/…` or `targets/…`) from an offset on.

Raises `HttpStatus`, `TryLater`.
"""


def source_of(connection: Connection) -> Source:
    """Makes a function that reads a file of the robot's update server from a position in bytes.

    It raises TryLater if the server cannot be reached, and HttpStatus if it refuses.
    """

    def read(path: str, start: int) -> Part:
        link = connect(connection, _TIMEOUT_S)
        headers = {"Authorization": f"TargetToken {connection.token}", "Connection": "close"}
        if start:
            headers["Range"] = f"bytes={start}-"
        try:
            link.request("GET", f"{connection.base}/repository/{quote(path)}", headers=headers)
            answer = link.getresponse()
        except (OSError, http.client.HTTPException) as error:
            link.close()
            raise TryLater(f"{path}: {error or type(error).__name__}") from error
        if answer.status not in (200, 206):
            link.close()
            raise HttpStatus(answer.status)
        return Part(start if answer.status == 206 else 0, _chunks(link, answer, path))

    return read


def _chunks(link: http.client.HTTPConnection, answer: http.client.HTTPResponse, path: str) -> Iterator[bytes]:
    try:
        while chunk := answer.read(CHUNK_BYTES):
            yield chunk
    except (OSError, http.client.HTTPException) as error:
        raise TryLater(f"{path}: {error or type(error).__name__}") from error
    finally:
        link.close()


def refusal(status: int, path: str) -> StepFailed | TryLater:
    """Returns the error for an HTTP status of the update server: a failed step for 403 and 404, else a later try."""
    if status == 403:
        return StepFailed("BadPermissionError", f"the store denies {path}")
    if status == 404:
        return StepFailed("ResourceNotFound", f"the store has no {path}")
    return TryLater(f"{path}: HTTP status {status}")


def fetch(source: Source, file: File, path: Path, progress: Callable[[int, int], None] | None = None) -> None:
    """Downloads a file to the robot, unless it is there; continues an interrupted download.

    Args:
        source: Source that the file is downloaded from.
        file: Signed length and hash of the file.
        path: Path of the complete file; while it is incomplete, its path ends with `.part`.
        progress: Called with the downloaded bytes and all bytes.

    Raises:
        StepFailed: The file differs from the signed one, does not exist, or does not fit on the disk.
        TryLater: The connection was cut; the downloaded part is kept.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        if path.exists():
            if _sha256(path) == file.sha256:
                return
            path.unlink()
        path.parent.mkdir(parents=True, exist_ok=True)
        _complete(source, file, part, progress or (lambda _done, _all: None))
        part.replace(path)
    except OSError as error:
        raise disk_failure(error, f"storing {file.address}") from error


def _complete(source: Source, file: File, part: Path, progress: Callable[[int, int], None]) -> None:
    """Downloads the missing part of a file; if it then has the wrong hash, downloads all of it again, once.

    Raises StepFailed if the hash is still wrong; the part is deleted then, and also after an error of the disk.
    """
    was_begun = part.exists()
    try:
        _receive(source, file, part, progress)
    except OSError:
        part.unlink()  # the agent's journal needs the space
        raise
    found = _sha256(part)
    if found != file.sha256:
        part.unlink()
        if not was_begun:
            raise StepFailed("EtagMismatch", f"{file.address} has SHA-256 {found}, {file.sha256} was signed")
        _complete(source, file, part, progress)


def _receive(source: Source, file: File, part: Path, progress: Callable[[int, int], None]) -> None:
    with part.open("ab") as target:
        done = target.tell()
        if done < file.length:
            received = _open(source, file, done)
            if received.start != done:
                target.truncate(0)
            done = received.start
            progress(done, file.length)
            for chunk in received.chunks:
                done += len(chunk)
                if done > file.length:
                    break
                target.write(chunk)
                progress(done, file.length)
        target.flush()
        size = target.tell()
    if done > file.length or size > file.length:
        part.unlink()
        raise StepFailed("EtagMismatch", f"{file.address} is longer than the {file.length} bytes that were signed")
    if size < file.length:
        raise TryLater(f"{file.address}: {size} of {file.length} bytes came")


def _open(source: Source, file: File, start: int) -> Part:
    try:
        return source(f"targets/{file.address}", start)
    except HttpStatus as error:
        raise refusal(error.status, file.address) from error


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as content:
        while chunk := content.read(1 << 20):
            digest.update(chunk)
    return digest.hexdigest()
