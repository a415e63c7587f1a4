"""How much may be asked of the page's server, and that nothing stops it."""

import contextlib
import json
import random
import socket
import sys
import time

import pytest
from websockets.exceptions import ConnectionClosed

from foreswitch.page.limits import LIMITS
from foreswitch.page.wire import unpack
from page.projects import HOT, INVERTER
from page.serving import PATIENCE, ask, said

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")


# How much -------------------------------------------------------------------------------------------------------------


def test_an_upload_is_cut_off_at_its_limit(page):
    limit = LIMITS["record"]
    before = page.memory()[0]
    status, sentence = said(page.post("/columns", b"1" * (limit + 1)))
    assert (status, sentence) == (413, f"the upload is longer than {limit} bytes; send less")
    # without a length, in pieces: cut off on the way
    with socket.create_connection(("127.0.0.1", page.port)) as raw:
        raw.settimeout(PATIENCE)
        raw.sendall(page.head("POST", "/columns", "Transfer-Encoding: chunked"))
        sent, piece = 0, b"10000\r\n" + b"1" * 65536 + b"\r\n"
        try:
            while sent < 40 * limit:
                raw.sendall(piece)
                sent += 65536
        except OSError:
            pass
        assert limit < sent < 3 * limit
    assert page.post("/export/project.toml", b"1" * (LIMITS["message"] + 1))[0] == 413
    assert page.get("/start.json", "GET", b"1")[0] == 413
    assert page.memory()[0] < before + 4 * limit


def test_slow_clients_keep_nobody_waiting(page):
    slow = [socket.create_connection(("127.0.0.1", page.port)) for _ in range(50)]
    try:
        for i, raw in enumerate(slow):
            raw.sendall(page.head("POST", "/columns", "Content-Length: 100")[: 20 if i % 2 else None])
        begun = time.monotonic()
        assert page.get("/start.json")[0] == 200
        with page.talk() as talk:
            assert ask(talk, "look", HOT)[1]["t"].size == 601
        assert time.monotonic() - begun < 5.0
    finally:
        for raw in slow:
            raw.close()


def test_a_long_message_ends_the_talk_and_no_other(page):
    with page.talk() as other:
        whole = "x" * (LIMITS["message"] + 1)
        for message in (whole, (whole[i : i + 1000] for i in range(0, len(whole), 1000))):  # and in fragments
            with page.talk() as talk, contextlib.suppress(ConnectionClosed):
                talk.send(message)
                talk.recv(timeout=PATIENCE)
                pytest.fail("it was answered")
        assert ask(other, "look", HOT)[1]["t"].size == 601


def test_nothing_is_unfolded(page):
    """A compressed message could be a thousand times as long as what is sent."""
    with page.talk(compression="deflate") as talk:
        assert "sec-websocket-extensions" not in talk.response.headers


def raw_talk(page):
    """A WebSocket without a library, for frames that none would send."""
    raw = socket.create_connection(("127.0.0.1", page.port))
    raw.settimeout(PATIENCE)
    key = "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
    raw.sendall(page.head("GET", "/ws", "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13", key))
    assert b" 101 " in raw.recv(4096)
    return raw


@pytest.mark.parametrize(
    "frames",
    [b"\x81\x82\0\0\0\0\xff\xfe", b"\xc1\x80\0\0\0\0", b"\x81\x01x", b"\x83\x80\0\0\0\0", b"\x89\xfe\x01\0" + bytes(300),
     b"\x80\x80\0\0\0\0", b"\x81\xff" + b"\x7f" * 8],
    ids=["no UTF-8", "compressed", "unmasked", "unknown kind", "long ping", "rest of nothing", "endless"],
)  # fmt: skip
def test_a_frame_that_breaks_the_rules_ends_the_talk(page, frames):
    with raw_talk(page) as raw:
        raw.sendall(frames)
        assert raw.recv(4096)[:1] == b"\x88"


@pytest.mark.parametrize("frame", [b"\x89\xfd" + bytes(129), b"\x00\x80\0\0\0\0"], ids=["pings", "empty fragments"])
def test_frames_without_end_do_not_fill_the_memory(page, frame):
    """Nobody reads the pongs; fragments of no length are never too long together."""
    with raw_talk(page) as raw:
        raw.sendall(b"\x01\x80\0\0\0\0")
        ended = False
        try:
            for _ in range(20_000):
                raw.sendall(frame * 300)
        except (BrokenPipeError, ConnectionResetError):
            ended = True
        assert ended
    with page.talk() as talk:
        assert ask(talk, "look", HOT)[1]["t"].size == 601


# The talk -------------------------------------------------------------------------------------------------------------


def test_what_is_out_of_date_is_said_to_be(page):
    """The first and the last of requests sent at once are computed; every one is answered once."""
    with page.talk() as talk:
        for i in range(40):
            talk.send(json.dumps({"id": i, "kind": "look", "project": HOT}))
        for i in range(40, 43):
            talk.send(json.dumps({"id": i, "kind": "look", "project": HOT, "lane": "pin"}))
        found = [unpack(talk.recv(timeout=PATIENCE)) for _ in range(43)]
    assert sorted(header["id"] for header, _ in found) == list(range(43))
    full = {header["id"] for header, arrays in found if arrays}
    assert {39, 42} <= full
    assert {header["id"] for header, _ in found if header.get("stale")} == set(range(43)) - full
    assert len(full) < 20


def test_only_so_many_requests_of_a_page_wait(page):
    """Each with a key of its own, so that none is out of date."""
    with page.talk() as talk:
        for i in range(60):
            talk.send(json.dumps({"id": i, "kind": "certify", "lane": str(i), "project": INVERTER}))
        first, _ = unpack(talk.recv(timeout=PATIENCE))
    assert "too many requests wait" in first["error"]["message"]


def test_a_look_does_not_wait_for_a_certificate(page):
    with page.talk() as talk:
        talk.send(json.dumps({"id": "slow", "kind": "certify", "project": INVERTER}))
        talk.send(json.dumps({"id": "fast", "kind": "look", "project": HOT}))
        assert unpack(talk.recv(timeout=PATIENCE))[0]["id"] == "fast"
        header, arrays = unpack(talk.recv(timeout=PATIENCE))
    assert header["id"] == "slow"
    assert header["holds"] is False
    assert arrays["ideal"].shape == (2, 1201)


HEAVY = {
    "long": ("simulation", {"duration": 1e9}),
    "fine": ("actuator", {"levels": [0, 1], "Ts": 1e-9}),
    "points": ("reference", {"kind": "points", "times": list(range(60000)), "values": [0] * 60000}),
    "many levels": ("actuator", {"levels": [i * 1e-3 for i in range(255)], "Ts": 1e-3}),
    "stiff": ("plant", {"model": "transfer_function", "num": [1e300], "den": [1e-300, 1e300, 1.0]}),
    "unstable": ("plant", {"model": "transfer_function", "num": [1.0], "den": [1.0, -1e5, 0.0]}),
    "nested": ("plant", json.loads("[" * 400 + "]" * 400)),
    "far valve": ("simulation", {"duration": 19.0, "disturbance": {"gain": 1.0, "high": 1.0}}),
    "huge numbers": ("controller", {"Td": 0.02, "lam": 1e308}),
    "drift": ("simulation", {"duration": 99.0, "hardware": {"opening": 0.0123, "closing": 50.0, "late": 0.9}}),
}  # fmt: skip


@pytest.mark.parametrize("name", HEAVY)
def test_any_project_is_answered_in_bounded_time(page, name):
    key, value = HEAVY[name]
    with page.talk() as talk:
        begun = time.monotonic()
        for kind in ("look", "costs"):
            header, arrays = ask(talk, kind, HOT | {key: value}, step=5)
            assert arrays or header["error"]["message"]
        assert time.monotonic() - begun < 30.0
        assert ask(talk, "look", HOT)[1]["t"].size == 601


def test_the_longest_horizon_is_answered(page):
    project = INVERTER | {"controller": {"objective": "horizon", "steps": 64, "preview": True, "terminal": "riccati"}}
    with page.talk() as talk:
        header, arrays = ask(talk, "look", project)
        assert arrays["u"].shape == (3, 1200)
        assert any("cut" in sentence for sentence in header["warnings"])


JUNK = random.Random(1)


def junk(i):
    """Anything but a request that can be answered."""
    kinds = (
        lambda: JUNK.randbytes(JUNK.randrange(200)),
        lambda: "".join(chr(JUNK.randrange(32, 0xD7FF)) for _ in range(JUNK.randrange(60))),
        lambda: json.dumps(JUNK.choice([None, 3, [], "x", {}, [[]], True, 1e300])),
        lambda: json.dumps({"id": JUNK.choice([None, 1.5, {}, [1], True, "x" * 100, -1]), "kind": "look"}),
        lambda: json.dumps({"id": i, "kind": JUNK.choice(["", "lok", None, 3, "__class__", "export"])}),
        lambda: json.dumps({"id": i, "kind": "look", "lane": JUNK.choice([None, 3, "x" * 100])}),
        lambda: '{"id": 1, "kind": "look"' + JUNK.choice(["", ",", "}}", ', "project": {', "\0"]),
        lambda: "[" * JUNK.choice([10, 100000]),
        lambda: '{"id": ' + "9" * JUNK.choice([30, 5000]) + ', "kind": "look"}',
        lambda: json.dumps(
            {"id": i, "kind": "look", "project": JUNK.choice([None, 3, [], {}, {"plant": 3}, {"plant": {}}])}
        ),
        lambda: json.dumps({"id": i, "kind": "costs", "project": HOT, "step": JUNK.choice([-1, 1e9, None, "x"])}),
        lambda: json.dumps(
            {"id": i, "kind": "look", "project": HOT | {"plant": JUNK.choice([[], "\ud800", {"k": "\0"}])}}
        ),
    )
    return JUNK.choice(kinds)()


def test_ten_thousand_bad_messages_leave_no_trace(page):
    """Each is answered, or its talk is ended; memory, threads, open files and processes are afterwards what they were."""

    def pelt(first, count):
        at, last, answers, ended = first, first + count, 0, 0
        while at < last:
            with page.talk() as talk:
                try:
                    while at < last:
                        burst = min(50, last - at)
                        for i in range(burst):
                            talk.send(junk(at + i))
                        at += burst
                        for _ in range(burst):
                            header, arrays = unpack(talk.recv(timeout=PATIENCE))
                            assert not arrays
                            assert header.get("stale") or header["error"]["message"]
                            answers += 1
                except ConnectionClosed:
                    ended += 1
        return answers

    pelt(0, 1000)  # what is loaded on first use
    workers, threads, files, memory = page.children(), page.threads(), page.files(), page.memory()
    begun = time.monotonic()
    assert pelt(1000, 10000) == 10000
    took = time.monotonic() - begun
    deadline = time.monotonic() + 5.0
    while page.files() > files and time.monotonic() < deadline:
        time.sleep(0.05)  # sockets are closed a moment later
    assert page.children() == workers
    assert page.threads() <= threads
    assert page.files() <= files
    for now, before in zip(page.memory(), memory, strict=True):
        assert now < before + (8 << 20)
    assert took < 60.0
    with page.talk() as talk:
        assert ask(talk, "look", HOT)[1]["t"].size == 601


def test_a_client_that_does_not_read_is_not_waited_for(page):
    """Its replies pile up no further than the socket takes; others are served meanwhile."""
    before = page.memory()[0]
    with page.talk(max_queue=1) as deaf, page.talk() as other:
        deaf.socket.settimeout(0.5)
        try:
            for i in range(3000):
                deaf.send(json.dumps({"id": i, "kind": "look", "lane": str(i), "project": HOT}))
        except OSError:
            pass
        for _ in range(5):
            assert ask(other, "look", HOT)[1]["t"].size == 601
        assert page.memory()[0] < before + (64 << 20)
        deaf.close_socket()
