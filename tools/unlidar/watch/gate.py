"""Access control, and headers of every answer.

Pages of other sites can neither read nor trigger anything: requests with a foreign host name (DNS
rebinding) are refused, and so are cross-site requests.
"""

import hashlib
import hmac
import re

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

LOCAL = ("localhost", "127.0.0.1", "::1")
_COOKIE = "unlidar"
_HOST = re.compile(r"(?:\[(?P<address>[0-9A-Fa-f:.]+)\]|(?P<name>[A-Za-z0-9.-]+))(?::[0-9]{1,5})?")
_OWN_SITE = ("same-origin", "none")  # none: address bar or bookmark
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'; require-trusted-types-for 'script'; trusted-types 'none'",
    "Cross-Origin-Embedder-Policy": "require-corp",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), display-capture=(), geolocation=(), microphone=(), "
    "payment=(), usb=()",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class Gate:
    """Middleware. Without a token only host names of this machine are accepted."""

    def __init__(self, app: ASGIApp, token: str | None) -> None:
        self._app, self._token = app, token
        # The cookie is derived from the token, not the token itself.
        self._pass = hashlib.sha256(f"unlidar:{token}".encode()).hexdigest()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return

        async def with_headers(message: dict) -> None:
            if message["type"] == "http.response.start":
                own = [(k.lower().encode(), v.encode()) for k, v in HEADERS.items()]
                message = message | {"headers": [*message["headers"], *own]}
            await send(message)

        await (self._answer(scope) or self._app)(scope, receive, with_headers)

    def _answer(self, scope: Scope) -> Response | None:
        """The answer to a refused request; None to let it pass."""
        request = Request(scope)
        if scope["method"] not in ("GET", "HEAD"):
            return PlainTextResponse("only GET\n", 405)
        if "upgrade" in request.headers:
            return PlainTextResponse("no other protocol is spoken\n", 400)
        if self._token is None and _host(request.headers) not in LOCAL:
            return PlainTextResponse("call this machine localhost\n", 421)
        if _is_foreign(scope["path"], request.headers):
            return PlainTextResponse("not for other sites\n", 403)
        if self._token is None:
            return None
        given = request.query_params.get("token")
        if given is not None and hmac.compare_digest(given.encode(), self._token.encode()):
            # Redirect to an address without the token, to keep it out of the history.
            answer = RedirectResponse("/", 303)
            secure = scope["scheme"] == "https"
            answer.set_cookie(
                _COOKIE, self._pass, max_age=30 * 86400, httponly=True, secure=secure,
                samesite="strict",
            )  # fmt: skip
            return answer
        if hmac.compare_digest(request.cookies.get(_COOKIE, "").encode(), self._pass.encode()):
            return None
        # Of programs, such as Prometheus, which keep no cookies.
        bearer = f"Bearer {self._token}".encode()
        if hmac.compare_digest(request.headers.get("authorization", "").encode(), bearer):
            return None
        return PlainTextResponse("add ?token=... to the address\n", 401)


def _is_foreign(path: str, headers: Headers) -> bool:
    """True for a cross-site request. Links to the page itself are allowed from anywhere."""
    origin = headers.get("origin")
    if origin is not None and origin.partition("://")[2] != headers.get("host"):
        return True
    if headers.get("sec-fetch-site", "none") in _OWN_SITE:
        return False
    is_link = headers.get("sec-fetch-mode") == "navigate"
    return not (is_link and headers.get("sec-fetch-dest") == "document" and path == "/")


def _host(headers: Headers) -> str | None:
    """The host of a Host header; None if malformed."""
    host = _HOST.fullmatch(headers.get("host", ""))
    return host and (host["address"] or host["name"]).lower()
