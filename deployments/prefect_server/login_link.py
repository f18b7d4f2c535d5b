"""Asks the local server for a link that logs a browser in once."""

import base64
import json
import urllib.error
import urllib.request

_TIMEOUT_S = 10.0

# The server is on this machine: no proxy has to see the secret.
_OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))


def login_link(api_url: str, auth_string: str) -> str | None:
    """A link that logs one browser in, within ten minutes; `None`: the server gives none.

    Args:
        api_url: API of the server.
        auth_string: the server's, `user:secret`.
    """
    basic = base64.b64encode(auth_string.encode()).decode()
    request = urllib.request.Request(  # noqa: S310 - an http URL of ours
        f"{api_url.removesuffix('/api')}/robomaker/login-links",
        data=b"",
        method="POST",
        headers={"Authorization": f"Basic {basic}"},
    )
    try:
        with _OPENER.open(request, timeout=_TIMEOUT_S) as answer:
            return str(json.load(answer)["link"])
    except (urllib.error.URLError, OSError, ValueError, KeyError):
        return None
