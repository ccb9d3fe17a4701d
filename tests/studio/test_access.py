from __future__ import annotations

import http.client
import json
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from dynid.core import InputError
from dynid.studio.page import Page
from dynid.studio.server import MOST_STREAMS, Server, access_policy, cookie_name, rule
from dynid.studio.session import open_path

TOKEN = "correct-horse-battery"
HOME = {"host": "127.0.0.1:8080"}
KNOWN = HOME | {"cookie": f"{cookie_name(8080)}={TOKEN}"}


def test_nobody_comes_in_without_a_token() -> None:
    assert access_policy("localhost", None).host == "127.0.0.1"
    for host in ("127.0.0.1", "::1", "0.0.0.0", "192.168.0.7", "::"):
        first, second = access_policy(host, None).token, access_policy(host, None).token
        assert len(first) >= 24
        assert first != second
        url = access_policy(host, TOKEN).url(8080)
        assert url.endswith(f":8080/?token={TOKEN}")
        # Which no other machine can open.
        assert "//0.0.0.0:" not in url
        assert "//[::]:" not in url
    assert rule(access_policy("127.0.0.1", None), 8080, "/", HOME).status == 403


@pytest.mark.parametrize(
    "token", ["", "short", "a" * 11, "with space in it", "ümläute-ümläute", "a;b" * 9]
)
def test_tokens_that_can_be_guessed_or_break_a_cookie_are_refused(token: str) -> None:
    with pytest.raises(InputError, match="token"):
        access_policy("0.0.0.0", token)


def test_what_is_no_address_is_refused() -> None:
    for host in ("", "example.org", "999.1.1.1", "127.0.0.1:80"):
        with pytest.raises(InputError, match="address"):
            access_policy(host, None)


def test_pages_of_other_sites_may_not_ask() -> None:
    policy = access_policy("127.0.0.1", TOKEN)
    assert rule(policy, 8080, "/", KNOWN).status == 200
    own = KNOWN | {"origin": "http://127.0.0.1:8080"}
    assert rule(policy, 8080, "/", own).status == 200
    for origin in ("http://evil.example", "null", "http://127.0.0.1:9", "https://x@127.0.0.1"):
        assert rule(policy, 8080, "/", KNOWN | {"origin": origin}).status == 403
    # A name of the attacker's that was made to point at this machine.
    for host in ("evil.example:8080", "127.0.0.1.evil.example", "", "[::1"):
        found = rule(policy, 8080, "/", KNOWN | {"host": host, "origin": f"http://{host}"})
        assert found.status == 403
    for host in ("localhost:8080", "[::1]:8080", "127.0.0.2:8080"):
        assert rule(policy, 8080, "/", KNOWN | {"host": host}).status == 200


def test_the_token_opens_once_and_the_cookie_after_it() -> None:
    policy = access_policy("0.0.0.0", TOKEN)
    far = {"host": "10.0.0.5:8080"}
    assert rule(policy, 8080, "/", far).status == 403
    assert rule(policy, 8080, "/?token=wrong", far).status == 403
    opened = rule(policy, 8080, f"/?token={TOKEN}", far)
    assert (opened.status, opened.cookie is not None) == (303, True)
    assert "HttpOnly" in str(opened.cookie)
    cookie = f"other=1; {cookie_name(8080)}={TOKEN}"
    assert rule(policy, 8080, "/", far | {"cookie": cookie}).status == 200
    assert rule(policy, 8081, "/", far | {"cookie": cookie}).status == 403
    wrong = f"{cookie_name(8080)}={TOKEN}x"
    assert rule(policy, 8080, "/", far | {"cookie": wrong}).status == 403
    foreign = far | {"cookie": cookie, "origin": "http://evil.example"}
    assert rule(policy, 8080, "/", foreign).status == 403


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("policy")
    server = Server(access_policy("127.0.0.1", TOKEN), 0, Page(open_path(str(folder), robot="ur5")))
    server.start()
    yield server
    server.page.close()
    server.stop()


def test_answers_give_way_however_low_the_priority_of_the_studio(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []

    def look_up(*_: object) -> dict[str, object]:
        seen.append(os.getpriority(os.PRIO_PROCESS, 0))
        return {}

    monkeypatch.setattr(Page, "look_up", look_up)
    page = Page(open_path(str(tmp_path), robot="ur5"))
    server = Server(access_policy("127.0.0.1", TOKEN), 0, page)

    def start() -> None:
        os.nice(15)
        server.start()

    thread = threading.Thread(target=start)
    thread.start()
    thread.join()
    try:
        assert ask(server.port, "/api/state", Cookie=cookie(server))[0] == 200
    finally:
        page.close()
        server.stop()
    assert seen == [19]


def ask(
    port: int, path: str, method: str = "GET", body: bytes | None = None, **headers: str
) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    try:
        connection.request(method, path, body, headers=headers)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()


def cookie(server: Server) -> str:
    status, headers, _ = ask(server.port, f"/?token={TOKEN}")
    assert (status, headers["Location"]) == (303, "/")
    return headers["Set-Cookie"].split(";")[0]


def test_the_server_itself_keeps_the_door(guarded: Server) -> None:
    port = guarded.port
    for path in ("/", "/studio.js", "/api/state", "/news", "/do/stop", "/drop?name=x.csv"):
        assert ask(port, path)[0] == 403
        assert ask(port, path, "POST", b"{}")[0] == 403
    known = cookie(guarded)
    status, headers, page = ask(port, "/", Cookie=known)
    assert status == 200
    assert b"<title>dynid studio</title>" in page
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert ask(port, "/api/state", Cookie=known)[0] == 200
    elsewhere = {"Origin": "http://evil.example"}
    assert ask(port, "/do/stop", "POST", b"{}", Cookie=known, **elsewhere)[0] == 403
    # What asks for no encoding gets the page, too.
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.putrequest("GET", "/", skip_accept_encoding=True)
    connection.putheader("Cookie", known)
    connection.endheaders()
    assert connection.getresponse().status == 200
    connection.close()


def test_a_bug_is_answered_too(guarded: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise KeyError("what nobody foresaw")

    monkeypatch.setattr(guarded.page, "state", broken)
    status, headers, body = ask(guarded.port, "/api/state", Cookie=cookie(guarded))
    assert (status, headers["Content-Type"].split(";")[0]) == (500, "application/json")
    assert "KeyError: 'what nobody foresaw'" in json.loads(body)["error"]


NONSENSE = [
    ("GET", "/nowhere", None), ("GET", "/../../etc/passwd", None), ("GET", "/%00", None),
    ("GET", "/api/nothing", None), ("GET", "/api/curves?name=x", None), ("PUT", "/", b""),
    ("DELETE", "/api/state", b""), ("POST", "/", b""), ("POST", "/do/", b"{}"),
    ("POST", "/do/rm", b"{}"), ("POST", "/do/choose", b"not json"), ("POST", "/do/choose", b"[1]"),
    ("POST", "/do/choose", b"\xff\xfe"), ("POST", "/do/choose", b'{"name": 7}'),
    ("POST", "/do/choose", b'{"name": "a", "name": "b"}'), ("POST", "/do/judge", b"[" * 9999),
    ("POST", "/do/judge", b'{"q": [1, 2]}'), ("POST", "/do/judge", b'{"q": [0,0,0,0,0,NaN]}'),
    ("POST", "/do/judge", b'{"t": "now"}'),
    ("POST", "/do/place", b'{"number": 9, "position": [0, 0, 0]}'),
    ("POST", "/do/run", b'{"repeat": 1, "target": "sim", "file": "x.parquet"}'),
    ("POST", "/do/design", b'{"criterion": "cond"}'), ("POST", "/do/export", b'{"to": "exe"}'),
    ("POST", "/do/results", b"{}"), ("POST", "/drop?name=../x.csv", b"1"),
    ("POST", "/drop?name=", b"1"), ("POST", "/drop?name=a.toml", b"not toml"),
    ("POST", "/drop?name=a.urdf", b"<robot"), ("POST", "/drop?name=a.json", b"{"),
]  # fmt: skip


@pytest.mark.parametrize(("method", "path", "body"), NONSENSE)
def test_nonsense_is_refused_in_a_sentence_and_is_no_fault_of_the_server(
    guarded: Server, method: str, path: str, body: bytes | None
) -> None:
    status, _, answer = ask(guarded.port, path, method, body, Cookie=cookie(guarded))
    if path.endswith("a.json"):
        # Unknown content is a log until its reader says no.
        assert status == 200
        assert guarded.page.session.job is not None
        guarded.page.session.job.wait(60)
        return
    assert 400 <= status < 500
    assert json.loads(answer)["error"]
    kept = [path.name for path in guarded.page.session.folder.iterdir()]
    assert not kept, kept


def test_a_body_without_or_with_too_great_a_length_is_refused(guarded: Server) -> None:
    known = cookie(guarded)
    for length in ("", "-1", "x", str(1 << 40)):
        with socket.create_connection(("127.0.0.1", guarded.port), timeout=20) as line:
            head = f"POST /do/stop HTTP/1.0\r\nHost: 127.0.0.1\r\nCookie: {known}\r\n"
            line.sendall(f"{head}Content-Length: {length}\r\n\r\n".encode())
            assert b" 413 " in line.recv(100)


def test_a_port_that_is_taken_is_said_at_once(guarded: Server) -> None:
    with pytest.raises(InputError, match="cannot listen"):
        Server(access_policy("127.0.0.1", None), guarded.port, guarded.page)
    # An address that no machine on earth has (documentation only, RFC 5737).
    with pytest.raises(InputError, match="cannot listen"):
        Server(access_policy("192.0.2.1", None), 0, guarded.page)


def test_cookies_of_other_programs_do_not_matter(guarded: Server) -> None:
    own = cookie(guarded)
    for other in ('prefs={"dark":true}', "a[]=1", "odd name=2", "=", ""):
        assert ask(guarded.port, "/api/state", Cookie=f"{other}; {own}; {other}")[0] == 200
    assert ask(guarded.port, "/api/state", Cookie='prefs={"dark":true}')[0] == 403


def test_news_of_many_tabs_leave_connections_for_a_stop(guarded: Server) -> None:
    known = {"Cookie": cookie(guarded)}
    lasting: list[http.client.HTTPConnection] = []
    try:
        for _ in range(MOST_STREAMS):
            connection = http.client.HTTPConnection("127.0.0.1", guarded.port, timeout=20)
            connection.request("GET", "/news", headers=known)
            lasting.append(connection)
            assert connection.getresponse().readline().startswith(b"retry: ")
        # The next one is told what there is, and is let go.
        status, _, body = ask(guarded.port, "/news", **known)
        assert status == 200
        assert b"retry: " in body
        assert json.loads(body.partition(b"data: ")[2])["motion"] == ""
    finally:
        for connection in lasting:
            connection.close()
