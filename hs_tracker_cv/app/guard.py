"""Who may talk to a page: whoever holds its token, from a page of its own, under its own name.

A server on the loopback interface can be reached by every user of the machine, and by every web page that its
user visits: directly, or as a name that resolves to 127.0.0.1 (DNS rebinding).
"""

from __future__ import annotations

import hmac
import secrets

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["Guard"]

HOSTS = ("127.0.0.1", "localhost", "[::1]")
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
HEADERS = {
    # Neither drawn inside another page, where clicks could be steered, nor told to one by a link.
    "content-security-policy": "frame-ancestors 'none'",
    "referrer-policy": "same-origin",
    "x-content-type-options": "nosniff",
}


class Guard:
    """ASGI middleware that refuses every request and every socket that is not the user's own.

    It asks three things of each, static files and sockets included. *Token*: the query ``token``, or the cookie
    (HttpOnly, SameSite=Strict) that the first request with the token brings back. *Host*: a name of the loopback
    interface with the bound port; Starlette's ``TrustedHostMiddleware`` compares no ports. *Origin*: the page
    itself wherever the header is sent, as browsers do for every socket, every unsafe method and every request
    from another origin; sockets and unsafe methods need it.

    Parameters
    ----------
    app : ASGI application
    port : int
        The port that the server is bound to.
    token : str
        Opens the page as often as it is shown.
    ticket : str
        Opens it once: for the address that is handed to the browser's command line, which other users can read.
    """

    def __init__(self, app: ASGIApp, *, port: int, token: str, ticket: str) -> None:
        self.app = app
        suffix = "" if port == 80 else f":{port}"
        self._hosts = frozenset(f"{host}{suffix}" for host in HOSTS)
        # Browsers send cookies to all ports of a host: two pages at a time need two names.
        self._cookie = f"hs-track-{port}"
        self._token = token
        self._ticket = ticket

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer 403; a socket is refused before it opens."""
        if scope["type"] not in {"http", "websocket"}:
            await self.app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        refusal = self._refusal(connection)
        if refusal:
            await PlainTextResponse(f"{refusal}\n", status_code=403)(scope, receive, send)
            return
        shown = "token" in connection.query_params

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(HEADERS)
                if shown:
                    headers.append("set-cookie", self._set_cookie())
            await send(message)

        await self.app(scope, receive, send_with_headers)

    def _refusal(self, connection: HTTPConnection) -> str:
        """Why a request is refused; empty if it is not."""
        hosts = connection.headers.getlist("host")
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return f"this page is at {' or '.join(sorted(self._hosts))} only (forwarded ports keep their number)"
        origins = connection.headers.getlist("origin")
        unsafe = connection.scope["type"] == "websocket" or connection.scope["method"] not in SAFE_METHODS
        if origins != [f"http://{hosts[0]}"] and (origins or unsafe):
            return "requests from other pages are refused"
        # Asked last, so that a request refused for its origin does not use the ticket up.
        if not self._is_known(connection):
            return "the address of this page has a token in it: open the one that hs-track has printed"
        return ""

    def _is_known(self, connection: HTTPConnection) -> bool:
        shown = connection.query_params.get("token", "").encode()
        kept = connection.cookies.get(self._cookie, "").encode()
        token = self._token.encode()
        known = hmac.compare_digest(shown, token) | hmac.compare_digest(kept, token)
        if not known and hmac.compare_digest(shown, self._ticket.encode()):
            self._ticket = secrets.token_urlsafe()
            return True
        return known

    def _set_cookie(self) -> str:
        # The token is URL-safe base64: nothing in it has to be quoted.
        return f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
