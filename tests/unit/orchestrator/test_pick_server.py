"""The server of the pick page: who may ask, what may be said, and that nothing but the page's own files is there."""

import http.client
import json
import re
import threading

import pytest

from toppling.orchestrator.pick.server import LARGEST_BODY, PickServer
from toppling.orchestrator.pick.user_hints import View

POLL_S = 0.01
"""How soon the server sees that it is to end."""
JSON = {"Content-Type": "application/json"}


class Heard:
    def __init__(self):
        self.view = View(3, (1, 0), (0.1, 0.1), b"points")
        self.said, self.ended = [], threading.Event()

    def work(self):
        self.ended.wait()

    def state(self):
        return {"number": 2}

    def wait(self, number, seconds):
        pass

    def set_hints(self, stated):
        self.said.append(stated)

    def save(self):
        pass

    def end(self):
        self.ended.set()


@pytest.fixture
def server():
    with PickServer(Heard()) as server:
        thread = threading.Thread(target=server.serve_forever, args=(POLL_S,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def asked(server, path, content=None, method=None, **headers):
    """Status and body of an answer; content that is no text is sent as JSON."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    body = content if isinstance(content, str | bytes | None) else json.dumps(content)
    headers = {"Host": f"127.0.0.1:{server.server_port}", **({} if body is None else JSON), **headers}
    connection.request(method or ("GET" if body is None else "POST"), path, body, headers)
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def post(server, path, content, **headers):
    return asked(server, f"/{server.secret}/{path}", content, **headers)


@pytest.mark.parametrize(
    ("method", "path"), [("GET", ""), ("GET", "state/0"), ("POST", "hints"), ("POST", "save")]
)
def test_only_who_knows_the_secret_and_asks_this_host_is_heard(server, method, path):
    body = "{}" if method == "POST" else None
    for direction in (f"/{path}", f"/wrong/{path}", f"/{server.secret}x/{path}"):
        assert asked(server, direction, body, method)[0] == 404
    inside = f"/{server.secret}/{path}"
    assert asked(server, inside, body, method, Host="rebound.example")[0] == 404
    assert asked(server, inside, body, method, Origin="http://elsewhere.example")[0] == 404
    own = server.address.rpartition("/")[0].rpartition("/")[0]
    assert asked(server, inside, body, method, Origin=own)[0] == 200
    assert asked(server, inside, body, method, Host=f"localhost:{server.server_port}")[0] == 200
    assert server.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize(
    "path",
    [
        "page.html", "pick/page.html", "../pyproject.toml", "..%2fpyproject.toml", "./pick.js", "pick.js/",
        "pick.js?x=1", "/etc/passwd", "vendor/three.LICENSE", "three.js/../../page.py", "cloud/2", "cloud/3/..",
        "state/x", "state/-1", "state/1e9", "state/99999999999999999999", "hints", "\\pick.js", "%00",
    ],
)  # fmt: skip
def test_nothing_but_the_page_is_there(server, path):
    assert asked(server, f"/{server.secret}/{path}")[0] == 404


@pytest.mark.parametrize(
    "content",
    [
        "", "{", "null", "[]", "7", '"near"', '{"near": "1 2"}', '{"near": [1]}', '{"near": [1, NaN]}',
        '{"near": [1, Infinity]}', '{"near": [1, true]}',
        '{"near": {"0": 1}}', '{"touch": [1, 2, 3]}', '{"touch": [[1, 2]]}', '{"touch": 3}',
        '{"plane": [0, 0, 0, 1]}', '{"units": "furlong"}', '{"up": "w"}', '{"up": [0, 1, 0]}',
        '{"length": [[0, 0, 0], [1, 0, 0]]}', '{"length": [[0, 0], [1, 0, 0], 2]}', '{"length": 3}',
        '{"out": "/tmp/x"}', '{"__class__": []}', "[" * 100_000,
        '{"near": [1e999, 0]}', '{"touch": [' + ",".join(["[0,0,0]"] * 1001) + "]}", b"\xff\xfe{}", '{"point": null}',
    ],
)  # fmt: skip
def test_what_is_no_hint_is_refused_and_nothing_is_taken_of_it(server, content):
    status, answer = post(server, "hints", content)
    assert status == 400
    assert "remedy:" in answer
    assert not server.picking.said


def test_what_is_too_long_or_has_no_length_is_not_read(server):
    assert post(server, "hints", '{"near": null' + " " * LARGEST_BODY + "}")[0] == 400
    for length in ("-1", "x", "1e3", "9" * 40):
        assert post(server, "hints", "{}", **{"Content-Length": length})[0] == 400
    assert post(server, "hints", "{}", **{"Content-Type": "text/plain"})[0] == 400
    assert not server.picking.said


def test_the_page_names_no_other_host(server):
    for name, (body, _) in server.files.items():
        if name != "three.js":
            assert not re.search(rb"""https?:(?!//www\.w3\.org/2000/svg")|["']//""", body), name
