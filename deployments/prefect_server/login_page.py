"""Login page for the local Prefect server: accepts a one-time token and redirects to Prefect's pages."""

import base64
import hashlib
import hmac
import json
import re
import secrets
import threading
import time
from collections.abc import Callable
from importlib.resources import files
from urllib.parse import urlencode, urlsplit

from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

LIFE_S = 600.0
"""Validity of a login token, in seconds: ten minutes."""

_MOST = 100
_TOKEN_BYTES = 24


class OneTimeTokens:
    """One-time tokens for login links to the local Prefect server.

    Args:
        life_s: Validity of a token, in seconds.
        clock: Seconds that only grow.
        make: Makes a token that cannot be guessed.
    """

    def __init__(
        self,
        life_s: float = LIFE_S,
        clock: Callable[[], float] = time.monotonic,
        make: Callable[[], str] = lambda: secrets.token_urlsafe(_TOKEN_BYTES),
    ) -> None:
        self._life_s = life_s
        self._clock = clock
        self._make = make
        self._expiries: dict[str, float] = {}
        self._lock = threading.Lock()

    def issue(self) -> str:
        """Makes a new token; the oldest becomes invalid beyond a hundred."""
        with self._lock:
            while len(self._expiries) >= _MOST:
                del self._expiries[next(iter(self._expiries))]
            token = self._make()
            self._expiries[token] = self._clock() + self._life_s
            return token

    def redeem(self, token: str) -> bool:
        """Returns whether a login token is valid, and makes it invalid."""
        with self._lock:
            expiry = self._expiries.pop(token, None)
            return expiry is not None and self._clock() < expiry


PAGE = "/robomaker/login"
LINKS = "/robomaker/login-links"
LOGO = "/robomaker/logo.svg"
"""URL path of the logo, so that pages need no picture of another site."""

_PASSWORD_PAGES = ("/login", "/v2/login")
"""URL paths of Prefect's own password pages, which are not used here."""

_MOST_BYTES = 1024
_NO_STORE = {"cache-control": "no-store"}


class LoginPage:
    """ASGI application in front of Prefect's server with pages for logging in.

    Args:
        application: Prefect's.
        origin: Origin of the server's pages, such as `http://127.0.0.1:4200`.
        auth_string: Credentials that a browser gets by logging in, `user:secret`.
    """

    def __init__(self, application: ASGIApp, origin: str, auth_string: str) -> None:
        self._application = application
        self._origin = origin
        self._password = base64.b64encode(auth_string.encode()).decode()
        self._tokens = OneTimeTokens()
        self._cookie = f"robomaker-login-{urlsplit(origin).port}"
        self._page = files(__package__ or "").joinpath("login.html").read_text(encoding="utf-8")
        self._logo = files(__package__ or "").joinpath("logo.svg").read_bytes()
        self._policy = _policy(self._page)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers requests about login, and passes all others on."""
        if scope["type"] == "http" and (response := await self._answer(Request(scope, receive))) is not None:
            await response(scope, receive, send)
        else:
            await self._application(scope, receive, send)

    async def _answer(self, request: Request) -> Response | None:
        method, path = request.method, request.scope["path"]
        if method == "GET" and _is_page(request) and f"http://{request.headers['host']}" != self._origin:
            # At `localhost` the page has another origin than its API, and would be a page of others.
            query = f"?{request.url.query}" if request.url.query else ""
            return RedirectResponse(f"{self._origin}{request.url.path}{query}", headers=_NO_STORE)
        if (method, path) == ("GET", PAGE):
            return HTMLResponse(self._page, headers={**_NO_STORE, "content-security-policy": self._policy})
        if (method, path) == ("GET", LOGO):
            return Response(self._logo, media_type="image/svg+xml")
        if (method, path) == ("POST", PAGE):
            return await self._log_in(request)
        if (method, path) == ("POST", LINKS):
            return self._link(request)
        if method == "GET" and _is_page(request) and (self._cookie not in request.cookies or path in _PASSWORD_PAGES):
            wanted = "/" if path in _PASSWORD_PAGES or path.startswith("/api/") else path
            return RedirectResponse(f"{PAGE}?{urlencode({'to': wanted})}", headers=_NO_STORE)
        return None

    async def _log_in(self, request: Request) -> Response:
        token = await _token(request)
        if token is None or not self._tokens.redeem(token):
            return JSONResponse({"detail": "this link was used before, or is too old"}, 403, _NO_STORE)
        return JSONResponse({"password": self._password}, headers=_NO_STORE)

    def _link(self, request: Request) -> Response:
        given = request.headers.get("authorization", "")
        if not hmac.compare_digest(given.encode(), f"Basic {self._password}".encode()):
            return JSONResponse({"detail": "the auth string of the server is missing or wrong"}, 401, _NO_STORE)
        return JSONResponse({"link": f"{self._origin}{PAGE}#{self._tokens.issue()}"}, 201, _NO_STORE)


def _is_page(request: Request) -> bool:
    return request.headers.get("sec-fetch-mode") == "navigate"


async def _token(request: Request) -> str | None:
    """Returns the login token in a request's JSON body; `None` if the body has none, is too large or breaks off."""
    body = b""
    try:
        async for part in request.stream():
            body += part
            if len(body) > _MOST_BYTES:
                return None
        token = json.loads(body)["token"]
    except (ClientDisconnect, ValueError, KeyError, TypeError, RecursionError):
        return None
    return token if isinstance(token, str) else None


def _policy(page: str) -> str:
    """Returns the content security policy that allows only the page's own script and style, by their hashes."""

    def hashes(element: str) -> str:
        texts = re.findall(f"<{element}>(.*?)</{element}>", page, re.DOTALL)
        digests = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in texts)
        return " ".join(f"'sha256-{digest}'" for digest in digests)

    return (
        f"default-src 'none'; script-src {hashes('script')}; style-src {hashes('style')}; connect-src 'self'; "
        "img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
