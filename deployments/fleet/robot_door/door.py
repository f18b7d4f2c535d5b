"""The door as an ASGI application: robots poll it, report to it, and download from it."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

from starlette.types import Receive, Scope, Send

from ....schemas.wire.errors import InvalidParameterException, ResourceNotFoundException, ServiceUnavailableException
from ....tasks.fleet.ddi.open_orders import (
    MAX_FEEDBACKS,
    OpenOrders,
    RobotState,
    base_document,
    cancel_document,
    order_document,
)
from ....tasks.fleet.ddi.received_reports import (
    AttributesSent,
    CancelFeedback,
    Feedback,
    OrderEnd,
    OrderFeedback,
    OrderFetched,
    RobotReport,
    RobotsSeen,
    parse_attributes,
    parse_feedback,
)
from ....tasks.fleet.ddi.robot_tokens import token_in
from .addresses import METHODS, Address, Addresses, Resource
from .agents import AgentAnswers, AgentSide
from .downloads import Downloads, ReadPart
from .last_seen import LastSeen
from .robot_answers import Disconnected, DoorRefusal, read_body, send_document, send_refusal

LOGGER = logging.getLogger("robomaker.robots")

_SINKS = 4
_SPREAD = 0.1
_CHALLENGE = [(b"www-authenticate", b"TargetToken")]


@dataclass(frozen=True)
class DoorSettings:
    """Poll intervals and limits that the update server gives to robots."""

    idle_sleep_s: int = 30
    """Time between two polls of an idle robot, in seconds; 10 % more or less, so that robots do not poll in step."""

    active_sleep_s: int = 1
    """Time between two polls while an order is open or expected, in seconds; more if too many robots poll so often."""

    active_polls_per_s: int = 250
    """Limit of the polls per second of robots that have an order or expect one."""

    last_seen_s: float = 3.0
    """Time for which polls of robots are collected before they are reported, in seconds."""

    tenant: str = "DEFAULT"
    """First part of every URL path of the update server (hawkBit's tenant)."""

    public_url: str | None = None
    """URL at which robots reach this server, without a path; `None`: as each request's `Host` says."""


@dataclass(frozen=True)
class _Request:
    scope: Scope
    receive: Receive
    send: Send
    address: Address
    state: RobotState
    headers: Mapping[bytes, bytes]


class RobotDoor:
    """Update server for robots (hawkBit's DDI API) as an ASGI application.

    Args:
        orders: The robots, and what is open for each.
        read_part: Reads a part of an order's file; called from threads.
        sink: Called with reports of robots, from threads; the robot waits for it, except for `RobotsSeen`. An
            order stays open until its last report was taken. If it raises, the response asks the robot to try again.
        clock: The time, in seconds since 1970.
        chance: Random numbers from 0 to below 1.
        settings: Poll intervals and limits.
        agents: Enrolment and update repository for this package's agents; `None`: not served.

    Raises:
        ConfigurationError: Tenant or public address are not right.
    """

    def __init__(
        self,
        orders: OpenOrders,
        *,
        read_part: ReadPart,
        sink: Callable[[RobotReport], None],
        clock: Callable[[], float],
        chance: Callable[[], float],
        settings: DoorSettings | None = None,
        agents: AgentSide | None = None,
    ) -> None:
        self.settings = settings or DoorSettings()
        self._addresses = Addresses(self.settings.tenant, self.settings.public_url)
        self._orders = orders
        self._sink = sink
        self._clock = clock
        self._chance = chance
        self._downloads = Downloads(read_part)
        self._agents = None if agents is None else AgentAnswers(agents, self._downloads, clock)
        self._last_seen = LastSeen(self._report_seen, self.settings.last_seen_s)
        self._threads = ThreadPoolExecutor(_SINKS, thread_name_prefix="robot-reports")
        self._serve: dict[Resource, Callable[[_Request], Awaitable[None]]] = {
            "base": self._poll,
            "order": self._order,
            "order_feedback": self._order_feedback,
            "cancel": self._cancel,
            "cancel_feedback": self._cancel_feedback,
            "attributes": self._attributes,
            "artifact": self._artifact,
            "metadata": self._repository,
            "target": self._repository,
        }

    @property
    def prefixes(self) -> tuple[str, ...]:
        """URL path prefixes that the update server answers."""
        return self._addresses.prefix, self._addresses.enrolment_prefix

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers one request of a robot, or the server's start and end (ASGI)."""
        if scope["type"] == "http":
            await self._answer(scope, receive, send)
        elif scope["type"] == "lifespan":
            while (message := await receive())["type"] != "lifespan.shutdown":
                await send({"type": f"{message['type']}.complete"})
            await self.close()
            await send({"type": "lifespan.shutdown.complete"})

    async def close(self) -> None:
        """Passes on the collected poll times of robots, and ends the threads."""
        self._last_seen.flush()
        await asyncio.to_thread(self._threads.shutdown)
        self._downloads.close()

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            address = self._addresses.read(scope["path"])
            headers = dict(scope["headers"])
            if address.resource == "enrolment":
                await self._enrolment(scope, receive, send, address, headers)
                return
            state = self._orders.check_token(address.robot, token_in(headers.get(b"authorization")))
            if state is None:
                raise DoorRefusal(401, "Authorization: TargetToken … of this robot is missing or wrong", _CHALLENGE)
            _check_method(scope, address.resource)
            await self._serve[address.resource](_Request(scope, receive, send, address, state, headers))
        except DoorRefusal as refusal:
            await send_refusal(send, refusal)
        except InvalidParameterException as error:
            await send_refusal(send, DoorRefusal(400, str(error)))
        except ResourceNotFoundException as error:  # the robot was taken out meanwhile
            await send_refusal(send, DoorRefusal(404, str(error)))
        except Disconnected:
            return

    async def _poll(self, request: _Request) -> None:
        state, robot = request.state, request.address.robot
        self._last_seen.note(robot, self._clock())
        is_active = state.order is not None or state.is_expected
        sleep_s = self._active_sleep_s() if is_active else self.settings.idle_sleep_s
        spread = 1 + _SPREAD * (2 * self._chance() - 1)
        await send_document(request.send, base_document(self._url(request), state, round(sleep_s * spread)))

    def _active_sleep_s(self) -> float:
        settings = self.settings
        slowest_s = max(settings.active_sleep_s, settings.idle_sleep_s)
        return min(slowest_s, max(settings.active_sleep_s, self._orders.active / settings.active_polls_per_s))

    async def _order(self, request: _Request) -> None:
        state, robot, action_id = request.state, request.address.robot, request.address.action_id
        if state.order is None or state.order.action_id != action_id or state.is_cancelling:
            raise DoorRefusal(404, f"robot {robot} has no order {action_id} to carry out")
        document = order_document(self._url(request), state.order)
        if not state.is_fetched:
            await self._report(OrderFetched(robot, action_id, self._clock()))
            self._orders.mark_fetched(robot, action_id)
        await send_document(request.send, document)

    async def _cancel(self, request: _Request) -> None:
        action_id = request.address.action_id
        if not request.state.has(action_id) or not request.state.is_cancelling:
            raise DoorRefusal(404, f"order {action_id} of robot {request.address.robot} is not being cancelled")
        await send_document(request.send, cancel_document(action_id))

    async def _order_feedback(self, request: _Request) -> None:
        feedback = await self._feedback(request)
        if feedback is not None:
            report = OrderFeedback(request.address.robot, feedback, self._clock())
            await self._take(request, report, feedback.order_end)

    async def _cancel_feedback(self, request: _Request) -> None:
        feedback = await self._feedback(request)
        if feedback is not None:
            if not self._orders.state(request.address.robot).is_cancelling:
                raise DoorRefusal(405, f"order {feedback.action_id} is not being cancelled")
            report = CancelFeedback(request.address.robot, feedback, self._clock())
            await self._take(request, report, feedback.cancel_end)

    async def _feedback(self, request: _Request) -> Feedback | None:
        """Parses the feedback of a request.

        Returns `None` if it repeats the feedback that closed the order, because the robot missed the answer.
        """
        body = await read_body(request.receive, request.headers.get(b"content-length"))
        robot, action_id = request.address.robot, request.address.action_id
        feedback = parse_feedback(action_id, body)
        state = self._orders.state(robot)  # the order may have ended while the body was under way
        if state.has(action_id):
            return feedback
        if feedback == state.last_feedback:
            await send_document(request.send, b"")
            return None
        if action_id <= state.last_action_id:
            raise DoorRefusal(410, f"order {action_id} has ended")
        raise DoorRefusal(404, f"robot {robot} has no order {action_id}")

    async def _take(self, request: _Request, report: OrderFeedback | CancelFeedback, end: OrderEnd | None) -> None:
        robot, feedback = report.robot, report.feedback
        count = self._orders.count_feedback(robot, feedback.action_id)
        if end is None and count > MAX_FEEDBACKS:
            raise DoorRefusal(
                429,
                f"order {feedback.action_id} has had {MAX_FEEDBACKS} feedbacks; only one that ends it is taken now",
            )
        await self._report(report)
        if end is not None:
            self._orders.close(robot, feedback.action_id, feedback)
        await send_document(request.send, b"")

    async def _attributes(self, request: _Request) -> None:
        attributes = parse_attributes(await read_body(request.receive, request.headers.get(b"content-length")))
        await self._report(AttributesSent(request.address.robot, attributes, self._clock()))
        self._orders.ask_attributes(request.address.robot, wants_attributes=False)
        await send_document(request.send, b"")

    async def _artifact(self, request: _Request) -> None:
        order, address = request.state.order, request.address
        if order is None or order.action_id != address.action_id or order.file_name != address.file:
            raise DoorRefusal(404, f"no order {address.action_id} of robot {address.robot} has this file")
        range_, if_range = request.headers.get(b"range"), request.headers.get(b"if-range")
        await self._downloads.serve(order, request.scope["method"], range_, if_range, request.receive, request.send)

    async def _repository(self, request: _Request) -> None:
        if self._agents is None:
            raise DoorRefusal(404, "there is no repository here")
        file, headers = request.address.file, request.headers
        if request.address.resource == "metadata":
            await self._agents.metadata(file, request.send)
            return
        range_, if_range = headers.get(b"range"), headers.get(b"if-range")
        await self._agents.target(file, request.scope["method"], range_, if_range, request.receive, request.send)

    async def _enrolment(
        self, scope: Scope, receive: Receive, send: Send, address: Address, headers: Mapping[bytes, bytes]
    ) -> None:
        if self._agents is None:
            raise DoorRefusal(404, "agents cannot enrol here")
        _check_method(scope, address.resource)
        authorization, length = headers.get(b"authorization"), headers.get(b"content-length")
        try:
            await self._agents.enrol(address.robot, authorization, length, receive, send)
        except ServiceUnavailableException as error:
            raise DoorRefusal(503, str(error), [(b"retry-after", b"5")]) from error

    def _url(self, request: _Request) -> str:
        return self._addresses.robot_url(request.scope, request.headers.get(b"host"), request.address.robot)

    async def _report(self, report: RobotReport) -> None:
        try:
            await asyncio.get_running_loop().run_in_executor(self._threads, self._sink, report)
        except Exception as error:
            LOGGER.exception("a report of robot %s could not be taken", getattr(report, "robot", ""))
            raise DoorRefusal(503, "this could not be stored; send it again", [(b"retry-after", b"5")]) from error

    def _report_seen(self, seen: Mapping[str, float]) -> None:
        self._threads.submit(self._sink, RobotsSeen(seen)).add_done_callback(_log_failure)


def _check_method(scope: Scope, resource: Resource) -> None:
    allowed = METHODS[resource]
    if scope["method"] not in allowed:
        names = ", ".join(allowed)
        raise DoorRefusal(405, f"only {names} is allowed here", [(b"allow", names.encode())])


def _log_failure(done: Future[None]) -> None:
    if not done.cancelled() and (error := done.exception()) is not None:
        LOGGER.error("when robots were last seen could not be stored: %s", error)
