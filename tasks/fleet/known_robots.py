"""The robots that are enrolled, as the catalog has them, in the table of those who speak to the robots."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from ...schemas.documents.fleets import RobotDocument, RobotEnrolment
from ...schemas.wire.errors import InvalidParameterException
from ..catalog import Resource
from ..service.service import Service
from .ddi.open_orders import OpenOrders
from .ddi.orders import is_robot_id
from .ddi.tokens import hash_token, new_token
from .records import ROBOT

_PAGE = 500


class _Enrolled(NamedTuple):
    arn: str
    token_sha256: str
    has_agent: bool
    tags: Mapping[str, str]


class KnownRobots:
    """Keeps the table up to date; a robot's id there is its name, which is unlike that of all others.

    Args:
        orders: the table.
    """

    def __init__(self, orders: OpenOrders) -> None:
        self._orders = orders
        self._by_id: dict[str, _Enrolled] = {}
        self._ids: dict[str, str] = {}

    def refresh(self, service: Service) -> None:
        """Lets in the robots that were enrolled since, and no longer those that were deleted, or have new tokens."""
        found = _enrolled(service)
        for robot in self._by_id.keys() - found.keys():
            self._orders.expel(robot)
        for robot, enrolled in found.items():
            before = self._by_id.get(robot)
            if before is not None and before.arn != enrolled.arn:  # another robot with the name of one that was deleted
                self._orders.expel(robot)
            if before is None or (before.arn, before.token_sha256) != (enrolled.arn, enrolled.token_sha256):
                self._orders.enrol(robot, bytes.fromhex(enrolled.token_sha256))
        self._by_id = found
        self._ids = {enrolled.arn: robot for robot, enrolled in found.items()}

    def arn(self, robot: str) -> str | None:
        """The ARN of a robot of that id; `None`: it is not enrolled any more."""
        enrolled = self._by_id.get(robot)
        return enrolled and enrolled.arn

    def id(self, arn: str) -> str | None:
        """The id of the robot of that ARN; `None`: it is not enrolled."""
        return self._ids.get(arn)

    def has_agent(self, robot: str) -> bool:
        """Whether the robot of that id runs our own agent."""
        enrolled = self._by_id.get(robot)
        return enrolled is not None and enrolled.has_agent

    def tags(self, robot: str) -> Mapping[str, str]:
        """The tags of the robot of that id; none if it is not enrolled."""
        enrolled = self._by_id.get(robot)
        return enrolled.tags if enrolled is not None else {}


def enrollable(name: str, service: Service) -> Resource:
    """The robot of a name.

    Raises:
        InvalidParameterException: there is no such robot, or updaters cannot have its name in an address.
    """
    robot = service.catalog.find(ROBOT, name)
    if robot is None:
        raise InvalidParameterException(f"there is no robot named {name!r}; make it with CreateRobot first")
    if not is_robot_id(name):
        raise InvalidParameterException(
            f"robot {name!r}: updaters put names into addresses, so its first character has to be a letter or a digit; "
            "make it under another name"
        )
    return robot


def replace_enrolment(**members: str | float | None) -> RobotEnrolment:
    """An enrolment that leaves nothing of the one before."""
    return RobotEnrolment.model_validate({**dict.fromkeys(RobotEnrolment.model_fields), **members})


def enrol(name: str, service: Service, random_bytes: Callable[[int], bytes], *, rotate: bool) -> str:
    """Gives a robot a token, of which the catalog keeps the hash.

    Args:
        name: the robot's.
        service: where it is stored.
        random_bytes: gives that many bytes that others cannot guess.
        rotate: whether a token that it has is replaced.

    Returns:
        The token; nothing can tell it again.

    Raises:
        InvalidParameterException: there is no such robot, it has a token that is not to be replaced, or updaters cannot
            have its name in an address.
    """
    robot = enrollable(name, service)
    token = new_token(random_bytes)

    def enrolled(stored: dict[str, object]) -> RobotEnrolment:
        if RobotDocument.model_validate(stored).token_sha256 is not None and not rotate:
            raise InvalidParameterException(
                f"robot {name!r} has a token already; --rotate replaces it, and the robot then needs the new one"
            )
        return replace_enrolment(token_sha256=hash_token(token).hex())

    service.catalog.update(robot.arn, enrolled)
    return token


def _enrolled(service: Service) -> dict[str, _Enrolled]:
    found: dict[str, _Enrolled] = {}
    after = None
    while True:
        page = service.catalog.list(ROBOT, limit=_PAGE, after=after, members=RobotEnrolment.members())
        for robot in page.resources:
            enrolment = RobotEnrolment.of_members(robot)
            token = enrolment.token_sha256
            if token is not None:
                found[robot.name] = _Enrolled(robot.arn, token, enrolment.has_agent, robot.tags)
        if (after := page.next_token) is None:
            return found
