"""Addresses that events are sent to and received from: parsed here, shown without secrets.

URLs hold users, passwords and tokens, which messages and the journal of a service would repeat.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import SplitResult, parse_qs, unquote, urlsplit

from unlidar.errors import UsageError
from unlidar.sanitize import hide_secrets

DIAL_S = 10.0  # for another machine to answer, or to take or send more of what has begun
LAST_WORDS_S = 5.0  # for what waits to be sent or stored when a program ends


@dataclass(frozen=True)
class Scheme:
    """Parts that an address of this scheme may have beside its host and port."""

    port: int | None = None  # None: the address must name one
    login: bool = False  # USER:PASSWORD@
    token: bool = False  # /?token=


MQTT = {"mqtt": Scheme(port=1883, login=True), "mqtts": Scheme(port=8883, login=True)}


@dataclass(frozen=True)
class Address:
    """Host, port and login of one endpoint."""

    scheme: str
    host: str
    port: int
    login: tuple[str, str | None] | None = field(default=None, repr=False)
    token: str | None = field(default=None, repr=False)

    @property
    def name(self) -> str:
        """The address without secrets, for messages."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


def read_address(text: str, schemes: Mapping[str, Scheme], expected: str) -> Address:
    """The parsed address. UsageError with the `expected` form and without the text's secrets."""
    try:
        return _read(urlsplit(text), schemes)
    except ValueError as error:
        raise UsageError(f"'{hide_secrets(text)}', expected {expected}") from error


def _read(url: SplitResult, schemes: Mapping[str, Scheme]) -> Address:
    scheme = schemes.get(url.scheme)
    if scheme is None or not url.hostname:
        raise ValueError("scheme or host")
    url.hostname.encode("idna")  # as the system's resolver will
    port = scheme.port if url.port is None else url.port
    if not port:
        raise ValueError("port")
    query = parse_qs(url.query, keep_blank_values=True)
    tokens = query.pop("token", [])
    if url.path.strip("/") or url.fragment or query or len(tokens) > scheme.token:
        raise ValueError("more than an address")
    if "@" in url.netloc and not (scheme.login and url.username):
        raise ValueError("login")
    login = None
    if url.username:
        login = unquote(url.username), None if url.password is None else unquote(url.password)
    return Address(url.scheme, url.hostname, port, login, next(iter(tokens), None))
