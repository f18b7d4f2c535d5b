"""Enrolment of robot agents: the server accepts a one-time token together with a token that the robot made itself.

The one-time token is 40 characters, a dash, and the SHA-256 of the TUF root that the robot is to trust. So the robot
knows whom to trust before its first request, and the server stores only a hash of the robot's own token.
"""

import hashlib
import hmac
import re
from typing import NamedTuple

from ....schemas.fleet.documents import RobotDocument, RobotEnrolment
from ....schemas.wire.errors import InvalidParameterException, ResourceNotFoundException
from ...catalog import Resource
from ...service.service import Service
from .keys import RandomBytes
from .metadata import Changes, to_bytes
from .publishing import publisher_of

VALID_S = 3600.0
"""Validity of a one-time token, in seconds."""

_ROBOT = "robot"
_SECRET_BYTES = 20
_SHA256 = re.compile(r"[0-9a-f]{64}")


class OneTimeToken(NamedTuple):
    """One-time token with which a person enrols a robot (lets it log in for the first time)."""

    text: str
    """Text of the whole token."""

    expires_s: float
    """Time until which the token is accepted, in seconds since the epoch."""


def offer(robot: Resource, service: Service, random_bytes: RandomBytes, *, rotate: bool) -> OneTimeToken:
    """Makes a one-time token for a robot's enrolment; the catalog stores only its hash.

    An earlier token of the robot becomes invalid.

    Args:
        robot: The robot.
        service: The service, with its catalog and object store.
        random_bytes: Function that returns that many unpredictable bytes.
        rotate: Whether a token that the robot has is to be replaced, once it comes with the one-time token.

    Raises:
        InvalidParameterException: The robot has a token that is not to be replaced.
        ConfigurationError: A key is missing, or the store has what the keys have not signed.
    """
    publisher = publisher_of(service)
    publisher.publish(lambda current: None if current else Changes())
    root = publisher.root()
    secret = random_bytes(_SECRET_BYTES).hex()
    expires_s = service.clock().timestamp() + VALID_S

    def offered(stored: dict[str, object]) -> RobotEnrolment:
        if RobotDocument.model_validate(stored).token_sha256 is not None and not rotate:
            raise InvalidParameterException(
                f"robot {robot.name!r} has a token already; --rotate replaces it as soon as the agent has enrolled"
            )
        return RobotEnrolment(
            enrolment_sha256=_hash(secret),
            enrolment_expires_s=expires_s,
            enrolment_taken=None,
            enrolment_root=root.signed.version,
        )

    service.catalog.update(robot.arn, offered)
    return OneTimeToken(f"{secret}-{hashlib.sha256(to_bytes(root)).hexdigest()}", expires_s)


def take(name: str, secret: str, token_sha256: str, service: Service) -> str | None:
    """Enrols an agent that shows its robot's one-time token, and returns the TUF root it has to trust.

    Args:
        name: The robot's.
        secret: The 40 characters of its one-time token.
        token_sha256: SHA-256 of the token that the robot made itself, in hexadecimal digits.
        service: The service, with its catalog and object store.

    Returns:
        The root that it is to trust, as JSON; the same again if the first answer got lost. `None`: the one-time token
        is wrong, too old, or was used with another token.

    Raises:
        InvalidParameterException: The hash is none.
        ServiceError: The catalog does not answer.
    """
    if not _SHA256.fullmatch(token_sha256):
        raise InvalidParameterException(
            f"tokenSha256: {ascii(token_sha256)[:60]} is not right; 64 lower-case hexadecimal digits are"
        )
    robot = service.catalog.find(_ROBOT, name)
    if robot is None:
        return None
    now_s = service.clock().timestamp()

    def taken(stored: dict[str, object]) -> RobotEnrolment:
        known = RobotDocument.model_validate(stored)
        if not _is_taken(known, secret, token_sha256, now_s):
            raise _Refused
        return RobotEnrolment(kind="agent", token_sha256=token_sha256, enrolment_taken=token_sha256)

    try:
        updated = service.catalog.update(robot.arn, taken)
    except (_Refused, ResourceNotFoundException):
        return None
    version = RobotDocument.of(updated).enrolment_root or 1
    return publisher_of(service).files.metadata("root", version).decode()


class _Refused(Exception):
    """Raised when a one-time token is wrong, to roll back the transaction."""


def _is_taken(known: RobotEnrolment, secret: str, token_sha256: str, now_s: float) -> bool:
    is_right = hmac.compare_digest(_hash(secret), known.enrolment_sha256 or "")
    is_young = known.enrolment_expires_s is not None and now_s < known.enrolment_expires_s
    return is_right and is_young and known.enrolment_taken in (None, token_sha256)


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()
