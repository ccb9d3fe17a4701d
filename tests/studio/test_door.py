from __future__ import annotations

import http.client
from collections.abc import Iterator
from typing import Any

import pytest

from dynid.core import InputError
from dynid.studio.server import cookie_name, make_door, open_server, rule

TOKEN = "correct-horse-battery"
HOME = {"host": "127.0.0.1:8080"}
KNOWN = HOME | {"cookie": f"{cookie_name(8080)}={TOKEN}"}


def test_nobody_comes_in_without_a_token() -> None:
    assert make_door("localhost", None).host == "127.0.0.1"
    for host in ("127.0.0.1", "::1", "0.0.0.0", "192.168.0.7", "::"):
        first, second = make_door(host, None).token, make_door(host, None).token
        assert len(first) >= 24
        assert first != second
        assert make_door(host, TOKEN).url(8080).endswith(f":8080/?token={TOKEN}")
    assert rule(make_door("127.0.0.1", None), 8080, "/", HOME).status == 403


@pytest.mark.parametrize(
    "token", ["", "short", "a" * 11, "with space in it", "ümläute-ümläute", "a;b" * 9]
)
def test_tokens_that_can_be_guessed_or_break_a_cookie_are_refused(token: str) -> None:
    with pytest.raises(InputError, match="token"):
        make_door("0.0.0.0", token)


def test_what_is_no_address_is_refused() -> None:
    for host in ("", "example.org", "999.1.1.1", "127.0.0.1:80"):
        with pytest.raises(InputError, match="address"):
            make_door(host, None)


def test_pages_of_other_sites_may_not_ask() -> None:
    door = make_door("127.0.0.1", TOKEN)
    assert rule(door, 8080, "/", KNOWN).status == 200
    own = KNOWN | {"origin": "http://127.0.0.1:8080"}
    assert rule(door, 8080, "/", own).status == 200
    for origin in ("http://evil.example", "null", "http://127.0.0.1:9", "https://x@127.0.0.1"):
        assert rule(door, 8080, "/", KNOWN | {"origin": origin}).status == 403
    # A name of the attacker's that was made to point at this machine.
    for host in ("evil.example:8080", "127.0.0.1.evil.example", "", "[::1"):
        found = rule(door, 8080, "/", {"host": host, "origin": f"http://{host}"})
        assert found.status == 403


def test_the_token_opens_once_and_the_cookie_after_it() -> None:
    door = make_door("0.0.0.0", TOKEN)
    far = {"host": "10.0.0.5:8080"}
    assert rule(door, 8080, "/", far).status == 403
    assert rule(door, 8080, "/?token=wrong", far).status == 403
    opened = rule(door, 8080, f"/?token={TOKEN}", far)
    assert (opened.status, opened.cookie is not None) == (303, True)
    assert "HttpOnly" in str(opened.cookie)
    cookie = f"other=1; {cookie_name(8080)}={TOKEN}"
    assert rule(door, 8080, "/", far | {"cookie": cookie}).status == 200
    assert rule(door, 8081, "/", far | {"cookie": cookie}).status == 403
    wrong = f"{cookie_name(8080)}={TOKEN}x"
    assert rule(door, 8080, "/", far | {"cookie": wrong}).status == 403
    foreign = far | {"cookie": cookie, "origin": "http://evil.example"}
    assert rule(door, 8080, "/", foreign).status == 403


@pytest.fixture(scope="module")
def guarded() -> Iterator[Any]:
    server = open_server(make_door("127.0.0.1", TOKEN), 0)
    yield server
    server.stop()


def ask(port: int, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()


def test_the_server_itself_keeps_the_door(guarded: Any) -> None:
    port = guarded.get_port()
    assert ask(port, "/")[0] == 403
    upgrade = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Protocol": "viser-v1.1.1",
    }
    assert ask(port, "/", **upgrade)[0] == 403
    status, headers, _ = ask(port, f"/?token={TOKEN}")
    assert (status, headers["Location"]) == (303, "/")
    cookie = headers["Set-Cookie"].split(";")[0]
    status, headers, page = ask(port, "/", Cookie=cookie)
    assert status == 200
    assert b"<title>dynid studio</title>" in page
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert "object-src 'none'" in headers["Content-Security-Policy"]
    assert ask(port, "/", Cookie=cookie, **upgrade)[0] == 101
    # What asks for no encoding gets the page, too.
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.putrequest("GET", "/", skip_accept_encoding=True)
    connection.putheader("Cookie", cookie)
    connection.endheaders()
    assert connection.getresponse().status == 200
    connection.close()
    elsewhere = {"Origin": "http://evil.example"}
    assert ask(port, "/", Cookie=cookie, **upgrade, **elsewhere)[0] == 403


def test_the_page_cannot_be_shared_through_a_relay(guarded: Any) -> None:
    import viser._messages as messages

    handlers = guarded._websock_server._incoming_handlers
    assert messages.ShareUrlRequest not in handlers


def test_a_port_that_is_taken_is_said_at_once(guarded: Any) -> None:
    with pytest.raises(InputError, match="cannot listen"):
        open_server(make_door("127.0.0.1", None), guarded.get_port())
    # An address that no machine on earth has (documentation only, RFC 5737).
    with pytest.raises(InputError, match="cannot listen"):
        open_server(make_door("192.0.2.1", None), 0)
