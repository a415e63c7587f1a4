"""The page's server: who may ask, from where, and that no process outlives it."""

import json
import signal
import socket
import subprocess
import sys
import time

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from foreswitch.page.limits import LIMITS
from foreswitch.page.presets import presets
from page.projects import HOT, INVERTER
from page.serving import COMMAND, PATIENCE, Page, alive, ask, free_port, said, served

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")


# What is there --------------------------------------------------------------------------------------------------------


def test_start_holds_what_the_page_needs(page):
    status, headers, body = page.get("/start.json")
    start = json.loads(body)
    assert (status, headers["content-type"]) == (200, "application/json")
    assert start["project"] == HOT
    assert [preset["name"] for preset in start["presets"]] == ["hot_gas", "chamber", "attitude", "oven", "inverter"]
    assert start["schema"]["actuator.Ts"]["unit"] == "s"
    assert start["schema"]["controller.objective"]["choices"] == ["endpoint", "horizon"]
    assert start["uses"]["plant"]["uses"]["fopdt"]["needed"] == ["K", "T"]
    assert start["limits"] == LIMITS


def test_only_packaged_files_are_served(page):
    assert page.get("/")[0] == 200
    assert page.get("/static/index.html")[1]["content-type"].startswith("text/html")
    for path in ("/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py", "/static//etc/passwd",
                 "/static/%2fetc/passwd", "/static/index.html%00", "/static/", "/static", "/../pyproject.toml",
                 "/static/uplot/../../server.py"):  # fmt: skip
        status, _, body = page.get(path)
        assert status == 404, path
        assert b"import" not in body


def test_every_reply_bears_the_headers_that_keep_it_in(page):
    replies = [page.get("/"), page.get("/start.json"), page.get("/nothing"), page.get("/", Host="evil.example"),
               page.post("/project", {}), page.get("/", "DELETE")]  # fmt: skip
    for _, headers, _ in replies:
        policy = headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert "*" not in policy
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cross-origin-resource-policy"] == "same-origin"
        assert headers["cache-control"] == "no-store"
        assert "server" not in headers


# Who may ask ----------------------------------------------------------------------------------------------------------

FOREIGN_HOSTS = ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:{other}", "127.0.0.1:{port}.evil.example",
                 "127.0.0.1:{port}@evil.example", "evil.example#127.0.0.1:{port}", "localhost.evil.example:{port}",
                 "127.0.0.1:0{port}", "0.0.0.0:{port}", "[::]:{port}", "[::ffff:127.0.0.1]:{port}", "::1:{port}",
                 "2130706433:{port}", "127.1:{port}", "localhost.:{port}", "", "127.0.0.1:{port}, evil.example"]  # fmt: skip


@pytest.mark.parametrize("host", FOREIGN_HOSTS)
def test_another_name_for_this_address_is_refused(page, host):
    """A name of somebody else's that points here: their script would count as ours (DNS rebinding)."""
    name = host.format(port=page.port, other=page.port + 1)
    assert said(page.get("/start.json", Host=name))[0] == 403
    with pytest.raises((InvalidStatus, ConnectionClosed)), page.talk(additional_headers={}, origin=f"http://{name}"):
        pass


def test_a_missing_or_second_name_is_refused(page):
    assert page.get("/start.json", Host=None)[0] in (400, 403)
    with socket.create_connection(("127.0.0.1", page.port)) as raw:
        raw.sendall(f"GET /start.json HTTP/1.1\r\nHost: {page.host}\r\nHost: evil.example\r\n\r\n".encode())
        assert b" 200 " not in raw.recv(4096).split(b"\r\n")[0]
    with socket.create_connection(("127.0.0.1", page.port)) as raw:
        raw.sendall(f"GET http://evil.example/start.json HTTP/1.1\r\nHost: {page.host}\r\n\r\n".encode())
        assert b" 200 " not in raw.recv(4096).split(b"\r\n")[0]


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost", "LOCALHOST", "[::1]"])
def test_names_of_this_machine_are_its_own(page, name):
    host = f"{name}:{page.port}"
    assert page.get("/start.json", Host=host)[0] == 200
    assert page.post("/columns", b"t,u,y\n", Host=host, Origin=f"http://{host.lower()}")[0] == 422


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "", "https://{host}", "http://{host}.evil.example", "http://127.0.0.1", "http://{host}/",
     "http://localhost:{port}", "file://", "{host}"],
)  # fmt: skip
def test_another_site_is_refused(page, origin):
    given = origin.format(host=page.host, port=page.port)
    assert said(page.get("/start.json", Origin=given))[0] == 403
    assert said(page.post("/project", {"toml": ""}, Origin=given))[0] == 403
    with pytest.raises(InvalidStatus) as refused, page.talk(origin=given):
        pass
    assert refused.value.response.status_code == 403


def test_whoever_does_not_say_where_it_comes_from_may_only_read(page):
    assert page.get("/start.json")[0] == 200
    assert page.post("/project", {"toml": ""}, Origin=None)[0] == 403
    assert page.get("/start.json", Sec_Fetch_Site="cross-site")[0] == 403
    assert page.get("/", Sec_Fetch_Site="cross-site", Sec_Fetch_Mode="navigate")[0] == 200
    with pytest.raises(InvalidStatus), page.talk(origin=None):
        pass


# Life and death -------------------------------------------------------------------------------------------------------


def test_a_project_that_is_named_is_the_first_shown(tmp_path):
    (tmp_path / "ref.csv").write_text("t,p\n0,1\n1,2\n")
    text = presets.__globals__["files"]("foreswitch").joinpath("examples/oven/project.toml").read_text()
    project = tmp_path / "project.toml"
    project.write_text(
        text.replace("programme.csv", "ref.csv").replace("t [s]", "t").replace('value = "oven [°C]"', 'value = "p"')
    )
    with served(str(project)) as page:
        start = json.loads(page.get("/start.json")[2])
    assert start["project"]["reference"] == {
        "kind": "points",
        "between": "linear",
        "times": [0.0, 1.0],
        "values": [1.0, 2.0],
    }


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_no_process_outlives_the_page(how):
    page = Page()
    with page.talk() as talk:
        talk.send(json.dumps({"id": 1, "kind": "certify", "project": INVERTER}))
        assert ask(talk, "look", HOT)[1]["t"].size == 601
        children = page.children()
        assert len(children) >= 2
        code, _, err = page.close(how)
    assert code == (0 if how == signal.SIGINT else -how)
    assert err == ""
    end = time.monotonic() + PATIENCE
    while any(map(alive, children)):
        assert time.monotonic() < end
        time.sleep(0.05)


def complaint(*arguments):
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 2
    assert done.stderr.startswith("foreswitch: ")
    assert done.stderr.count("\n") == 1
    return done.stderr


def test_what_cannot_be_listened_at_is_said_in_one_sentence(page):
    assert f"port {page.port}" in complaint("--port", str(page.port))
    assert "--remote" in complaint("--host", "0.0.0.0")
    assert "--remote" in complaint("--host", "192.0.2.1")
    assert "192.0.2.1" in complaint("--host", "192.0.2.1", "--remote")
    assert "cannot be read" in complaint("nowhere.toml")


def test_without_the_extra_it_says_what_to_install():
    program = (
        "import sys\nfor name in ('starlette', 'uvicorn', 'websockets'): sys.modules[name] = None\n"
        "from foreswitch.cli import main\nmain(['page', '--no-open'])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 2
    assert "pip install 'foreswitch[page]'" in done.stderr
    assert done.stderr.count("\n") == 1


# Beyond this machine --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def far():
    """Listening at all addresses; what it prints is the only way in."""
    with served("--host", "0.0.0.0", "--remote") as found:
        yield found


def test_elsewhere_a_token_is_needed(far):
    token = far.link.split("?token=")[1]
    assert len(token) >= 43  # 256 bits
    for path in ("/", "/start.json", "/static/index.html", "/?token=", "/?token=" + "x" * 43, f"/start.json?token={token}",
                 f"/?token={token[:-1]}", f"/?token=x&token={token}"):  # fmt: skip
        assert said(far.get(path))[0] == 403, path
    assert said(far.get("/start.json", Cookie=f"foreswitch-{far.port}=wrong"))[0] == 403
    assert said(far.get("/start.json", Cookie=f"foreswitch-{far.port}=\xe9"))[0] == 403
    with pytest.raises(InvalidStatus), far.talk():
        pass

    status, headers, body = far.get(f"/?token={token}")
    assert status == 200
    kept = headers["set-cookie"]
    assert "HttpOnly" in kept
    assert "SameSite=Strict" in kept
    assert token.encode() not in body
    cookie = kept.split(";")[0]
    assert far.get("/start.json", Cookie=f"other=1; {cookie}")[0] == 200
    assert said(far.get("/start.json", Cookie=cookie, Host=f"evil.example:{far.port}"))[0] == 403
    assert said(far.post("/project", {}, Cookie=cookie, Origin="http://evil.example"))[0] == 403
    assert far.get("/start.json", Cookie=cookie, Host=f"192.0.2.7:{far.port}")[0] == 200
    with far.talk(additional_headers={"Cookie": cookie}) as talk:
        assert ask(talk, "look", HOT)[1]["t"].size == 601


@pytest.mark.parametrize("host", ["127.0.0.2", "::1"])
def test_any_address_of_this_machine_alone_will_do(host):
    try:
        with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as tried:
            tried.bind((host, 0))
    except OSError:
        pytest.skip("this machine has no such address")
    page = Page("--host", host, waits=False)
    try:
        with page.talk() as talk:
            assert ask(talk, "look", HOT)[1]["t"].size == 601
    finally:
        assert page.close()[::2] == (0, "")


def test_a_free_port_is_found():
    port = free_port()
    with served("--port", str(port)) as page:
        assert page.port == port
