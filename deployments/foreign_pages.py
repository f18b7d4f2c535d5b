"""Protection of local servers from web pages of other sites, by Host, Origin and Sec-Fetch-Site of each request."""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Literal

from starlette.types import ASGIApp, Message, Receive, Scope, Send

RawHeaders = Iterable[tuple[bytes, bytes]]
"""HTTP headers as in ASGI: names in lower case, and values."""

_NAMES = (b"host", b"origin", b"sec-fetch-site", b"sec-fetch-mode", b"sec-fetch-dest")
_READS = ("GET", "HEAD")
_OWN_SITES = ("same-origin", "none")
_SHOWN = 100


@dataclass(frozen=True)
class Refusal:
    """Reason why an HTTP request from a foreign web page is refused."""

    status: int
    """HTTP status of the response: 400 for a wrong `Host`, else 403."""

    reason: str
    """Sentence that tells why a request is refused."""


def refusal(
    kind: Literal["http", "websocket"],
    method: str,
    headers: RawHeaders,
    is_own_host: Callable[[str], bool],
    schemes: Collection[str] = ("http",),
) -> Refusal | None:
    """Returns why a request is refused because a foreign web page may have sent it; `None` if it is allowed.

    Args:
        kind: Kind of the requested resource.
        method: The method, in capitals; of a WebSocket any.
        headers: The request's headers.
        is_own_host: Whether a `Host` names this server and no web site can have that name.
        schemes: URL schemes that the server's own pages may have; with `https` a proxy before it may end TLS.
    """
    found = _found(headers)
    hosts, origins = found[b"host"], found[b"origin"]
    if len(hosts) != 1 or not is_own_host(hosts[0]):
        return Refusal(400, f"Host is {_shown(hosts)}, which is no name of this server")
    # Only a page at the very same address is our own: at another port, or at the address of version 6 that `localhost`
    # also is, another user's server may listen.
    if origins and origins not in [[f"{scheme}://{hosts[0]}"] for scheme in schemes]:
        return Refusal(403, f"the request comes from a web page of {_shown(origins)}; pages of others may not send any")
    if site := _foreign_site(kind, method, found):
        return Refusal(403, f"the request comes from a web page of another site ({site})")
    return None


def foreign_site(method: str, headers: RawHeaders) -> str | None:
    """Returns the `Sec-Fetch-Site` header of a request that another site's page sent; `None` otherwise.

    If a person follows a link from another site, that site cannot read the page, so navigation of a whole tab is
    allowed.

    Args:
        method: The method, in capitals.
        headers: The request's headers.
    """
    return _foreign_site("http", method, _found(headers))


def is_loopback_host(host: str) -> bool:
    """Whether a `Host` header is `127.0.0.1` or `localhost`, with any port."""
    name, _, port = host.lower().partition(":")
    return name in ("127.0.0.1", "localhost") and (port.isdecimal() or not port)


def _foreign_site(kind: Literal["http", "websocket"], method: str, found: dict[bytes, list[str]]) -> str | None:
    sites = found[b"sec-fetch-site"]
    if all(site in _OWN_SITES for site in sites):
        return None
    is_navigation = found[b"sec-fetch-mode"] == ["navigate"] and found[b"sec-fetch-dest"] == ["document"]
    return None if kind == "http" and method in _READS and is_navigation else _shown(sites)


def _found(headers: RawHeaders) -> dict[bytes, list[str]]:
    found: dict[bytes, list[str]] = {name: [] for name in _NAMES}
    for name, value in headers:
        if name in found:
            found[name].append(value.decode("latin-1").strip())
    return found


def _shown(values: list[str]) -> str:
    return repr(", ".join(values)[:_SHOWN])


_POLICY_VIOLATION = 1008

_ADDED = (
    (b"x-frame-options", b"DENY"),
    (b"content-security-policy", b"frame-ancestors 'none'; connect-src 'self'"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
)
"""HTTP headers added to every response: pages of this server can neither be framed nor talk to other servers."""

_CORS = b"access-control-"


class Guard:
    """ASGI application wrapper that refuses requests of foreign web pages to a server that listens at 127.0.0.1.

    It also removes CORS headers from the application's responses, and adds headers by which its pages can neither be
    framed nor talk to other servers.

    Args:
        application: The ASGI application to protect.
    """

    def __init__(self, application: ASGIApp) -> None:
        self._application = application

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serves a request, a WebSocket, or the server's start and end, but refuses what pages of other sites send.

        A refused request gets an error response; a refused WebSocket is closed before it is accepted.
        """
        if scope["type"] not in ("http", "websocket"):
            await self._application(scope, receive, send)
            return
        refused = refusal(scope["type"], scope.get("method", "GET"), scope["headers"], is_loopback_host)
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
