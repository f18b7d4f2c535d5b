"""Refuses requests of web pages where the service needs no signatures.

Any page that a browser on this machine shows can send requests to 127.0.0.1. Three marks give them
away, and none is on a request of an SDK:

- a page of another site: browsers put `Origin` on every POST, PUT and DELETE, and a page cannot
  take it off;
- its other requests, such as pictures and frames: `Sec-Fetch-Site` says that another site asks;
- a page whose site's name was pointed at 127.0.0.1 after it was loaded ("DNS rebinding"): `Host` has the site's
  name. That is a name with dots, which no name of this machine or of a container network is.
"""

import ipaddress
import re

from ..foreign_pages import foreign_site
from .protocol_errors import AccessDeniedException
from .service_requests import ServiceRequest

_HOST = re.compile(r"(?P<name>\[[^\]]*\]|[^:\[\]]*)(:[0-9]{1,5})?")
_ONE_LABEL = re.compile(r"[a-z0-9_-]+")


def check_origin(request: ServiceRequest) -> None:
    """Raises an error for requests that web pages of other sites could send.

    Raises:
        AccessDeniedException: The request has an `Origin`, a `Host` that may be any site's name, or comes from a page
            of another site that is not left for ours.
    """
    if (origin := request.headers.get("origin")) is not None:
        raise AccessDeniedException(
            f"the request comes from a web page of {origin[:100]!r}; pages may not call this service"
        )
    hosts = request.headers.getlist("host")
    if len(hosts) != 1 or not is_local_host(hosts[0]):
        shown = ", ".join(hosts)[:100]
        raise AccessDeniedException(
            f"Host is {shown!r}; without access keys this service answers at localhost, at addresses and at names "
            "without dots. Configure access keys to use another name"
        )
    if site := foreign_site(request.method, request.headers.raw):
        raise AccessDeniedException(f"the request comes from a web page of another site ({site})")


def is_local_host(host: str) -> bool:
    """Whether a `Host` header cannot belong to a web site: an address, `localhost`, or a name without dots."""
    if (match := _HOST.fullmatch(host.strip().lower())) is None:
        return False
    name = match["name"].rstrip(".")
    return bool(_ONE_LABEL.fullmatch(name)) or name.endswith(".localhost") or is_address(name)


def is_address(name: str) -> bool:
    """Whether a host is an IP address."""
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


def is_loopback(host: str) -> bool:
    """Whether a host is a loopback address, reachable only from this machine."""
    return host == "localhost" or (is_address(host) and ipaddress.ip_address(host.strip("[]")).is_loopback)
