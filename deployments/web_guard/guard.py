"""An ASGI application around another one, which only sees requests that no web page of others sent."""

from collections.abc import Callable

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .decision import Refusal, is_loopback_host, refusal

_POLICY_VIOLATION = 1008

_ADDED = (
    (b"x-frame-options", b"DENY"),
    (b"content-security-policy", b"frame-ancestors 'none'; connect-src 'self'"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
)
"""No page may frame ours or embed anything of it, and ours may talk to nothing but its own server."""

_CORS = b"access-control-"


class Guard:
    """Refuses requests of other web pages, and takes what lets them in off the answers.

    Args:
        application: the one that is guarded.
        is_own_host: whether a request's `Host` names this server; by default one that listens at 127.0.0.1.
    """

    def __init__(self, application: ASGIApp, is_own_host: Callable[[str], bool] = is_loopback_host) -> None:
        self._application = application
        self._is_own_host = is_own_host

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves a request, a WebSocket, or the server's start and end."""
        if scope["type"] not in ("http", "websocket"):
            await self._application(scope, receive, send)
            return
        refused = refusal(scope["type"], scope.get("method", "GET"), scope["headers"], self._is_own_host)
        if refused is None:
            await self._application(scope, receive, _closing(send))
        elif scope["type"] == "websocket":
            # Before it is accepted: the handshake is answered with 403.
            await send({"type": "websocket.close", "code": _POLICY_VIOLATION, "reason": refused.reason})
        else:
            await _refuse(refused, send)


def _closing(send: Send) -> Send:
    async def close(message: Message) -> None:
        if message["type"] == "http.response.start":
            own = {name for name, _ in message.get("headers", ())}
            kept = [header for header in message.get("headers", ()) if not header[0].lower().startswith(_CORS)]
            message = {**message, "headers": [*kept, *(header for header in _ADDED if header[0] not in own)]}
        await send(message)

    return close


async def _refuse(refused: Refusal, send: Send) -> None:
    body = f"{refused.reason}\n".encode()
    headers = [
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"content-length", str(len(body)).encode()),
        (b"cache-control", b"no-store"),
        (b"x-content-type-options", b"nosniff"),
    ]
    await send({"type": "http.response.start", "status": refused.status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
