"""Who may come in: whoever knows the token, on this machine too.

A page in a browser may talk to any address of this machine, and this page can move a robot. So
requests that another site's page sends are refused: its `Origin` is not ours, and a name that
was made to point here is not one of this machine's.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import SplitResult, parse_qs, urlsplit

from dynid.core import InputError

DEFAULT_HOST = "127.0.0.1"
SHORTEST_TOKEN = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Door:
    """The rules of one page."""

    host: str
    """Address to listen on."""
    token: str
    """What a visitor must know: other users and programs of this machine can come too."""

    @property
    def loopback(self) -> bool:
        """Whether no other machine can reach the page."""
        return ipaddress.ip_address(self.host).is_loopback

    def url(self, port: int) -> str:
        """The address to open, token included."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/?token={self.token}"


@dataclass(frozen=True, slots=True)
class Ruling:
    """What becomes of a request."""

    status: int
    """200 to go on, 303 to go on with the cookie that was set, 403 to refuse."""
    reason: str = ""
    cookie: str | None = None
    """Value of `Set-Cookie`."""


def make_door(host: str, token: str | None) -> Door:
    """The rules for an address.

    Args:
        host: An address of this machine; `localhost` is 127.0.0.1.
        token: What visitors must know; None to make one up.

    Raises:
        InputError: No address, or a token that is too short or does not fit into one.
    """
    try:
        address = ipaddress.ip_address(DEFAULT_HOST if host == "localhost" else host)
    except ValueError as error:
        raise InputError(
            "this is no address", where="--host", value=host, limit="such as 127.0.0.1 or 0.0.0.0"
        ) from error
    if token is not None and not _hard_to_guess(token):
        raise InputError(
            "the token can be guessed, or cannot stand in an address",
            where="--token",
            limit=f"{SHORTEST_TOKEN} or more letters, digits, - and _",
            next_step="Leave it out and one is made up.",
        )
    return Door(host=str(address), token=token or secrets.token_urlsafe(24))


def rule(door: Door, port: int, path: str, headers: Mapping[str, str]) -> Ruling:
    """Whether a request may pass.

    Args:
        door: The rules.
        port: Where the page listens.
        path: The request's path, with its query.
        headers: The request's, by their names in lower case.
    """
    host = headers.get("host", "")
    origin = headers.get("origin")
    if origin is not None and _parts(origin).netloc != host:
        return Ruling(403, "a page of another site asked")
    if door.loopback and not _names_this_machine(host):
        return Ruling(403, "the address is not one of this machine")
    name = cookie_name(port)
    given = parse_qs(_parts(path).query).get("token", [""])[0]
    if _same(given, door.token):
        return Ruling(303, cookie=f"{name}={door.token}; HttpOnly; SameSite=Lax; Path=/")
    if _same(_cookie(headers.get("cookie", ""), name), door.token):
        return Ruling(200)
    return Ruling(403, "open the whole address that dynid studio printed, with its token")


def cookie_name(port: int) -> str:
    """The cookie of one page; cookies of all ports of a machine are shared."""
    return f"dynid_studio_{port}"


def _parts(address: str) -> SplitResult:
    try:
        return urlsplit(address)
    except ValueError:
        # Nonsense is nobody's address.
        return SplitResult("", "", "", "", "")


def _hard_to_guess(token: str) -> bool:
    allowed = all(c.isascii() and (c.isalnum() or c in "-_") for c in token)
    return allowed and len(token) >= SHORTEST_TOKEN


def _names_this_machine(host: str) -> bool:
    name = _parts(f"//{host}").hostname or ""
    if name == "localhost":
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def _cookie(text: str, name: str) -> str:
    try:
        found = SimpleCookie(text).get(name)
    except CookieError:
        return ""
    return "" if found is None else found.value


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())
