"""Answers of `robomaker serve` to agents besides orders: enrolment, and the repository."""

from collections.abc import Callable
from pathlib import Path

from ...schemas.wire.errors import ObjectNotFoundError, StorageError
from ...tasks.fleet.trust.serving import RepositoryReader
from ...tasks.service.service import Service
from ..robot_door.downloads import ServedFile


class ServedAgents:
    """Answers the door, from any thread.

    Args:
        service: where robots and repository are stored.
        enrolled: told when an agent was let in, so that it is known soon.
    """

    def __init__(self, service: Service, enrolled: Callable[[], None]) -> None:
        self._service = service
        self._enrolled = enrolled
        self._reader = RepositoryReader(service)

    def enrol(self, robot: str, secret: str, token_sha256: str) -> str | None:
        """Lets an agent in; see `enrolment.take`."""
        from ...tasks.fleet.trust.enrolment import take  # it needs the extra `fleet`

        root = take(robot, secret, token_sha256, self._service)
        if root is not None:
            self._enrolled()
        return root

    def metadata(self, name: str) -> bytes:
        """A file of the repository's metadata; see `RepositoryReader.metadata`."""
        return self._reader.metadata(name)

    def target(self, path: str) -> ServedFile:
        """A target; see `RepositoryReader.target`."""
        here = self._reader.target(path)
        try:
            size_bytes = here.stat().st_size
        except OSError as error:
            raise ObjectNotFoundError(f"there is no target {path}: {error.strerror}") from error
        # The name begins with the content's hash.
        sha256 = path.rpartition("/")[2].partition(".")[0]
        return ServedFile(f"the target {path}", size_bytes, sha256, lambda start, length: _read(here, start, length))


def _read(path: Path, start: int, length: int) -> bytes:
    try:
        with path.open("rb") as file:
            file.seek(start)
            return file.read(length)
    except OSError as error:
        raise StorageError(f"{path.name} cannot be read: {error.strerror}") from error
