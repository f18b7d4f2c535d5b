"""Login with an access key, and identification of the visitor of a request."""

import logging
from collections.abc import Awaitable, Callable
from urllib.parse import quote

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from ...schemas.wire.errors import ThrottlingException
from ..endpoint.protocol_errors import ProtocolError
from .orders.forms import read_fields
from .rendering import HOME, render
from .sessions import LIFETIME_S
from .visit import Context, Visit, cookie_name

LOGGER = logging.getLogger("robomaker.endpoint")
_MOST_BYTES = 16_384


def visit_of(request: Request, context: Context) -> Visit | None:
    """Returns the logged-in visit of a request; `None` if the visitor has to log in first."""
    if context.sessions is None:
        return Visit(request, context, None)
    session = context.sessions.find(request.cookies.get(cookie_name(request)))
    return None if session is None else Visit(request, context, session)


def ask(request: Request) -> Response:
    """Redirects a visitor to the login page of the web console; forms and streams get status 403 instead."""
    if request.method != "GET" or request.url.path.endswith("/live"):
        return Response("log in first\n", 403, media_type="text/plain")
    wanted = request.url.path + (f"?{request.url.query}" if request.url.query else "")
    return RedirectResponse(f"{HOME}/login?to={quote(wanted)}", 303)


def show_form(context: Context) -> Callable[[Request], Response]:
    """Makes the handler that shows the console's login page, or redirects a visitor who is logged in."""

    def show(request: Request) -> Response:
        to = own_address(request.query_params.get("to", ""))
        if visit_of(request, context) is not None:
            return RedirectResponse(to, 303)
        return HTMLResponse(render("login.html.j2", to=to, problem=""))

    return show


def log_in(context: Context) -> Callable[[Request], Awaitable[Response]]:
    """Makes the handler of the web console's login form, which checks the access key and starts a session.

    The handler sets the session's cookie and redirects to the page that was asked for. A wrong key gets status 403
    and too many attempts 429, with the form again and a line in the log. Without sessions it only redirects.
    """

    async def take(request: Request) -> Response:
        try:
            form = await read_fields(request, _MOST_BYTES)
        except ProtocolError:
            form = {}
        to = own_address(form.get("to", ""))
        if context.sessions is None:
            return RedirectResponse(to, 303)
        client = request.client.host if request.client else ""
        key_id = form.get("key", "").strip()
        try:
            token = await run_in_threadpool(context.sessions.log_in, key_id, form.get("secret", "").strip(), client)
        except (ProtocolError, ThrottlingException) as error:
            LOGGER.warning("a login to the console from %s as %s failed: %s", client, ascii(key_id)[:100], error)
            status = 429 if isinstance(error, ThrottlingException) else 403
            return HTMLResponse(render("login.html.j2", to=to, problem=str(error)), status)
        response = RedirectResponse(to, 303)
        is_https = request.url.scheme == "https"
        # Lax: a link in a message leads a visitor who is logged in to the page; forms of other sites bring no cookie.
        response.set_cookie(
            cookie_name(request), token, max_age=LIFETIME_S, path=HOME, httponly=True, samesite="lax", secure=is_https
        )
        return response

    return take


def log_out(visit: Visit) -> Response:
    """Ends the visitor's session in the web console, deletes its cookie, and redirects to the login page."""
    if visit.context.sessions is not None:
        visit.context.sessions.log_out(visit.request.cookies.get(cookie_name(visit.request)))
    response = RedirectResponse(f"{HOME}/login", 303)
    response.delete_cookie(cookie_name(visit.request), path=HOME)
    return response


def own_address(address: str) -> str:
    """Returns a URL if it belongs to the console, else that of the console's first page."""
    is_own = address == HOME or address.startswith((f"{HOME}/", f"{HOME}?"))
    return address if is_own and "\\" not in address and address.isprintable() else HOME
