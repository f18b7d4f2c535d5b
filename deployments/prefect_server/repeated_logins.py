"""Has the sockets of events hear each client's login once.

Prefect's client of events connects again from two places: where it sends, and where it asks at intervals whether what
it sent has arrived. Both may do so at once after the server was away. Then both log in on the same socket. Prefect's
server takes the second login for an event, fails with a traceback and closes the socket.
"""

import json

from starlette.types import ASGIApp, Message, Receive, Scope, Send

_PATH = "/events/in"


class RepeatedLogins:
    """An ASGI application that passes on the first login of each socket of events, and drops others."""

    def __init__(self, application: ASGIApp) -> None:
        self._application = application

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers a request, or serves a socket."""
        is_of_events = scope["type"] == "websocket" and scope["path"].endswith(_PATH)
        await self._application(scope, _first_login(receive) if is_of_events else receive, send)


def _first_login(receive: Receive) -> Receive:
    is_logged_in = False

    async def receive_next() -> Message:
        nonlocal is_logged_in
        while True:
            message = await receive()
            if not _is_login(message):
                return message
            if not is_logged_in:
                is_logged_in = True
                return message

    return receive_next


def _is_login(message: Message) -> bool:
    text = message.get("text")
    # An event starts with its own members; only what may be a login is read twice.
    if message["type"] != "websocket.receive" or not text or '"auth"' not in text[:40]:
        return False
    try:
        content = json.loads(text)
    except ValueError:
        return False
    return isinstance(content, dict) and content.get("type") == "auth"
