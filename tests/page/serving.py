"""A page served for a test by a process of its own, ended by its id."""

import contextlib
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

from websockets.sync.client import connect

from foreswitch.page.wire import unpack

COMMAND = [sys.executable, "-c", "from foreswitch.cli import main; main()", "page", "--no-open", "--port", "0"]
#: Seconds for what takes one or two on a machine with nothing else to do.
PATIENCE = 60.0


class Page:
    """``foreswitch page``; ``link`` is what it prints."""

    def __init__(self, *arguments, waits=True):
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(
            [*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
        )
        self.link = self.process.stdout.readline().split(" ")[0].strip()
        found = re.match(r"http://(\[.*\]|[^:]*):(\d+)/", self.link)
        assert found, (self.link, self.process.stderr.read())
        self.host, self.port = f"{found[1]}:{found[2]}", int(found[2])
        if waits:
            self.wait()

    def wait(self):
        """Until it answers."""
        end = time.monotonic() + PATIENCE
        while True:
            with contextlib.suppress(OSError, http.client.HTTPException):
                self.get("/nothing")
                return
            assert time.monotonic() < end, "the page does not answer"
            time.sleep(0.05)

    def warm(self):
        """Until its processes have loaded; whoever needs a token is not let in."""
        if "token" not in self.link:
            with self.talk() as talk:
                talk.send('{"id": 0, "kind": "look"}')
                talk.recv(timeout=60.0)

    def get(self, path, method="GET", body=None, **headers):
        """Status, headers, body; ``Host`` and ``Origin`` as a browser sends them, None leaves one out."""
        given = {"Host": self.host} | ({"Origin": f"http://{self.host}"} if method == "POST" else {}) | headers
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            if body is not None:
                connection.putheader("Content-Length", str(len(body)))
            for name, value in given.items():
                if value is not None:
                    connection.putheader(name.replace("_", "-"), value)
            connection.endheaders()
            if body is not None:
                with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                    connection.send(body)
            response = connection.getresponse()
            return response.status, {k.lower(): v for k, v in response.getheaders()}, response.read()
        finally:
            connection.close()

    def post(self, path, body, **headers):
        """JSON, or bytes."""
        return self.get(path, "POST", body if isinstance(body, bytes) else json.dumps(body).encode(), **headers)

    def head(self, method, path, *lines):
        """The beginning of a request, byte for byte, for what no library would send."""
        given = (f"{method} {path} HTTP/1.1", f"Host: {self.host}", f"Origin: http://{self.host}", *lines, "", "")
        return "\r\n".join(given).encode()

    def talk(self, **options):
        """A WebSocket."""
        settings = {"origin": f"http://{self.host}", "compression": None, "max_size": None, "open_timeout": PATIENCE}
        return connect(f"ws://{self.host}/ws", **settings | options)

    def children(self):
        """Ids of the processes that it started."""
        found = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        return [int(each) for each in found]

    def memory(self):
        """Resident [bytes], of the server and of each child."""
        pages = [int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in (self.process.pid, *self.children())]
        return [count * os.sysconf("SC_PAGE_SIZE") for count in pages]

    def threads(self):
        return len(list(Path(f"/proc/{self.process.pid}/task").iterdir()))

    def files(self):
        return len(list(Path(f"/proc/{self.process.pid}/fd").iterdir()))

    def close(self, how=signal.SIGINT):
        """End it; its exit code and what it had to complain of."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        try:
            out, err = self.process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            out, err = self.process.communicate()
        return self.process.returncode, out, err


@contextlib.contextmanager
def served(*arguments):
    """A page that must not complain of anything."""
    page = Page(*arguments)
    try:
        page.warm()
        yield page
    except BaseException:
        print(page.close())
        raise
    code, _, err = page.close()
    assert (code, err) == (0, ""), err


def ask(socket, kind, project, *, name=1, **more):
    """One request and its reply."""
    socket.send(json.dumps({"id": name, "kind": kind, "project": project, **more}))
    return unpack(socket.recv(timeout=PATIENCE))


def free_port():
    """One that nobody uses now."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def alive(pid):
    """Whether a process runs, zombies aside."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def said(reply):
    """Status and sentence of a refusal."""
    status, _, body = reply
    return status, json.loads(body)["error"]["message"]
