"""Responses to robot agents apart from orders: files of the TUF repository, and enrolment."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from starlette.types import Receive, Send

from ....schemas.wire.errors import InvalidParameterException
from .downloads import Downloads, ServedFile
from .robot_answers import DoorRefusal, read_body, send_plain

MOST_GUESSES = 10
"""Limit of wrong one-time tokens of one robot within `GUESS_WINDOW_S`; further ones are refused unchecked."""

GUESS_WINDOW_S = 60.0

_MOST_NAMES = 10_000
_SCHEME = b"enrolmenttoken"
_SECRET = re.compile(rb"[A-Za-z0-9]{40}")
_CHALLENGE = [(b"www-authenticate", b"EnrolmentToken")]


class AgentSide(Protocol):
    """Interface for enrolling robots' agents and reading the update repository; called from threads."""

    def enrol(self, robot: str, secret: str, token_sha256: str) -> str | None:
        """Enrols an agent by a one-time token.

        Returns:
            The root that it is to trust; `None`: the one-time token is not right.
        """
        ...

    def metadata(self, name: str) -> bytes:
        """Returns a TUF metadata file of the update repository.

        Raises:
            ObjectNotFoundError: The repository has no metadata file of this name.
            StorageError: The file cannot be read.
        """
        ...

    def target(self, path: str) -> ServedFile:
        """Returns an update file of the repository, by its path with the hash before the name.

        Raises:
            ObjectNotFoundError: The repository has no such file.
            StorageError: The file cannot be read.
        """
        ...


@dataclass
class _Guesses:
    since_s: float
    count: int = 0


class GuessLimit:
    """Counts wrong one-time tokens for each robot, against guessing.

    Args:
        clock: The time, in seconds since 1970.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._guesses: dict[str, _Guesses] = {}

    def check(self, robot: str) -> None:
        """Raises an error for a robot with too many wrong tokens.

        Raises:
            DoorRefusal: Too many (429).
        """
        guesses = self._guesses.get(robot)
        now_s = self._clock()
        if guesses is None or now_s - guesses.since_s >= GUESS_WINDOW_S:
            self._guesses.pop(robot, None)
        elif guesses.count >= MOST_GUESSES:
            wait_s = max(1, round(GUESS_WINDOW_S - (now_s - guesses.since_s)))
            raise DoorRefusal(
                429,
                f"{MOST_GUESSES} one-time tokens of robot {robot} were wrong; try again in {wait_s} s",
                [(b"retry-after", b"%d" % wait_s)],
            )

    def note_wrong(self, robot: str) -> None:
        """Counts a wrong one-time token of a robot."""
        if len(self._guesses) >= _MOST_NAMES:  # made-up names shall not fill the memory
            self._guesses.clear()
        self._guesses.setdefault(robot, _Guesses(self._clock())).count += 1


class AgentAnswers:
    """Answers HTTP requests of agents on robots: enrolment and update repository.

    Args:
        side: Enrols agents and reads the repository.
        downloads: Sends files, and has the threads.
        clock: The time, in seconds since 1970.
    """

    def __init__(self, side: AgentSide, downloads: Downloads, clock: Callable[[], float]) -> None:
        self._side = side
        self._downloads = downloads
        self._limit = GuessLimit(clock)

    async def metadata(self, name: str, send: Send) -> None:
        """Sends a TUF metadata file to a robot agent."""
        content = await self._downloads.run(lambda: self._side.metadata(name))
        await send_plain(send, content)

    async def target(
        self, path: str, method: str, range_: bytes | None, if_range: bytes | None, receive: Receive, send: Send
    ) -> None:
        """Sends an update file, or a part of it, to a robot agent."""
        file = await self._downloads.run(lambda: self._side.target(path))
        await self._downloads.serve_file(file, method, range_, if_range, receive, send)

    async def enrol(
        self, robot: str, authorization: bytes | None, length: bytes | None, receive: Receive, send: Send
    ) -> None:
        """Answers an agent's request to enrol with a one-time token.

        Raises:
            DoorRefusal: The token is not right (401), or too many were wrong (429).
            InvalidParameterException: The body is not right.
        """
        self._limit.check(robot)
        token_sha256 = _token_sha256(await read_body(receive, length))
        secret = _secret_in(authorization)
        root = None
        if secret is not None:
            root = await self._downloads.run(lambda: self._side.enrol(robot, secret, token_sha256))
        if root is None:
            self._limit.note_wrong(robot)
            raise DoorRefusal(
                401, "Authorization: EnrolmentToken … is wrong, too old, or was used with another token", _CHALLENGE
            )
        await send_plain(send, json.dumps({"root": root}).encode())


def _secret_in(authorization: bytes | None) -> str | None:
    scheme, _, secret = (authorization or b"").partition(b" ")
    secret = secret.strip()
    if scheme.lower() != _SCHEME or not _SECRET.fullmatch(secret):
        return None
    return secret.decode()


def _token_sha256(body: bytes) -> str:
    try:
        document = json.loads(body.decode())
    except (ValueError, RecursionError):
        raise InvalidParameterException("the body is no JSON in UTF-8") from None
    value = document.get("tokenSha256") if isinstance(document, dict) else None
    if not isinstance(value, str):
        raise InvalidParameterException("tokenSha256 is missing; 64 lower-case hexadecimal digits are right")
    return value
