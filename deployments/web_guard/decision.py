"""Whether a request comes from a web page of somebody else, decided by its headers alone.

Three headers give such pages away. A page can neither take them off nor change them:

- `Host`: a site whose name was pointed at 127.0.0.1 after its page was loaded ("DNS rebinding") is still asked for by
  that name.
- `Origin`: browsers put the page's origin on every WebSocket, on every POST, PUT, PATCH and DELETE, and on reads that
  the page wants to see the answers of.
- `Sec-Fetch-Site`: on every request to this machine, with `same-origin` for the server's own pages and `none` for
  what a person typed or bookmarked. Another port of 127.0.0.1 is `same-site`.

Programs that are no browsers have neither `Origin` nor `Sec-Fetch-Site`.
"""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Literal

RawHeaders = Iterable[tuple[bytes, bytes]]
"""Names in lower case, and values, as ASGI has them."""

_NAMES = (b"host", b"origin", b"sec-fetch-site", b"sec-fetch-mode", b"sec-fetch-dest")
_READS = ("GET", "HEAD")
_OWN_SITES = ("same-origin", "none")
_SHOWN = 100


@dataclass(frozen=True)
class Refusal:
    """Why a request is refused."""

    status: int
    """Status of the answer: 400 for a wrong `Host`, else 403."""

    reason: str
    """One sentence for the answer."""


def refusal(
    kind: Literal["http", "websocket"],
    method: str,
    headers: RawHeaders,
    is_own_host: Callable[[str], bool],
    schemes: Collection[str] = ("http",),
) -> Refusal | None:
    """Says why a request is refused; `None`: it is not.

    Args:
        kind: what is asked for.
        method: the method, in capitals; of a WebSocket any.
        headers: the request's headers.
        is_own_host: whether a `Host` names this server and no web site can have that name.
        schemes: those that the server's own pages may have; with `https` a proxy before it may end TLS.
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
    """The `Sec-Fetch-Site` of an HTTP request that a page of another site sent; `None` of every other.

    A person who follows a link from another site comes to a page of ours, which that site does not see: a navigation
    of a whole tab is allowed.

    Args:
        method: the method, in capitals.
        headers: the request's headers.
    """
    return _foreign_site("http", method, _found(headers))


def is_loopback_host(host: str) -> bool:
    """Whether a `Host` is `127.0.0.1` or `localhost`, with any port: pages of others cannot have it with ours."""
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
