"""The server: who may ask, and what there is to get."""

import http.client
import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from torchsphere.pick.server import MOST_BYTES, PickServer
from torchsphere.pick.session import Session
from torchsphere.synthetic import demo_shot as demo


class Client:
    """Requests to a server, with everything right unless a test says otherwise."""

    def __init__(self, server: PickServer) -> None:
        self.server, self.root = server, f"/{server.token}/"

    def ask(
        self, path: str, body: bytes | None = None, *, host: str | None = None, whole: bool = False, **headers: str
    ) -> tuple[int, bytes, dict[str, str]]:
        connection = http.client.HTTPConnection("127.0.0.1", self.server.server_port, timeout=60)
        sent = {"Host": host or f"127.0.0.1:{self.server.server_port}"}
        if body is not None:
            sent["Content-Type"] = "application/json"
        sent |= {name.replace("_", "-"): value for name, value in headers.items()}
        method = "GET" if body is None else "POST"
        try:
            connection.request(method, path if whole else self.root + path, body, sent)
            answer = connection.getresponse()
            return answer.status, answer.read(), {name.lower(): value for name, value in answer.getheaders()}
        finally:
            connection.close()

    def get(self, path: str) -> Any:
        status, body, _ = self.ask(path)
        assert status == 200, body
        return json.loads(body)

    def post(self, path: str, values: Any, status: int = 200) -> Any:
        found, body, _ = self.ask(path, json.dumps(values).encode())
        assert found == status, body
        return json.loads(body)


@pytest.fixture
def client(session: Session) -> Iterator[Client]:
    with PickServer(session) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        yield Client(server)
        server.shutdown()
        thread.join()


def test_the_server_listens_on_this_machine_alone(client: Client) -> None:
    assert client.server.server_address[0] == "127.0.0.1"
    assert client.server.address == f"http://127.0.0.1:{client.server.server_port}{client.root}"
    assert len(client.server.token) >= 32


def test_the_page_is_one_file_with_the_facts_of_the_recording(client: Client) -> None:
    status, body, headers = client.ask("")
    page = body.decode()
    assert status == 200
    assert "short.tif" in page
    assert "8 frames of 384 x 192 px" in page
    assert "src=" not in page.replace("image.src=", "")
    assert headers["cache-control"] == "no-store"
    assert headers["referrer-policy"] == "no-referrer"
    assert "frame-ancestors 'none'" in headers["content-security-policy"]


@pytest.mark.parametrize("path", ["", "frame?n=0", "progress", "result/report.html"])
def test_without_the_token_nothing_is_answered(client: Client, path: str) -> None:
    wrong = "A" * len(client.server.token)
    for start in (
        "/",
        f"/{wrong}/",
        f"/{client.server.token[:-1]}/",
        f"/{wrong}/../{client.server.token}/",
        "//",
        "/%C3%A9/",
    ):
        status, body, headers = client.ask(start + path, whole=True)
        assert status == 403
        assert "token" in json.loads(body)["error"]
        assert headers["connection"] == "close"
    status, _, _ = client.ask("/save", b"{}", whole=True)
    assert status == 403


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1", "127.0.0.1.evil.example:1", "[::1]:1"]
)
def test_a_name_that_is_made_to_point_here_is_refused(client: Client, host: str) -> None:
    status, body, _ = client.ask("", host=host)
    assert status == 403
    assert json.loads(body)["error"] == "this server answers to 127.0.0.1 alone"


def test_a_page_of_another_origin_is_refused(client: Client) -> None:
    assert client.ask("stop", b"{}", Origin="http://evil.example")[0] == 403
    assert client.ask("stop", b"{}", Origin="null")[0] == 403
    assert client.ask("stop", b"{}", Origin=f"http://127.0.0.1:{client.server.server_port}")[0] == 200


def test_the_address_without_its_last_slash_leads_to_the_page(client: Client) -> None:
    status, _, headers = client.ask(f"/{client.server.token}", whole=True)
    assert (status, headers["location"]) == (308, client.root)


@pytest.mark.parametrize(
    ("body", "headers"),
    [
        (b"{}", {"Content_Type": "text/plain"}),
        (b"{", {}),
        (b"[1]", {}),
        (b"\xff", {}),
        (b"[" * 100_000, {}),
        (b"{}", {"Content_Length": str(MOST_BYTES + 1)}),
        (b"{}", {"Content_Length": "-1"}),
    ],
)
def test_a_request_that_no_page_sends_gets_one_sentence(client: Client, body: bytes, headers: dict[str, str]) -> None:
    status, answer, _ = client.ask("check", body, **headers)
    assert status == 400
    assert "load the page again" in json.loads(answer)["error"]


def test_what_is_not_there_is_not_found(client: Client) -> None:
    for path in ("secret", "save", "frame/", "../pyproject.toml", "%2e%2e/%2e%2e/etc/passwd", "pick.css"):
        assert client.ask(path)[0] == 404
    assert client.ask("progress", b"{}")[0] == 404


def test_frames_and_refusals_of_frames(client: Client) -> None:
    status, body, headers = client.ask("frame?n=7&black=10&white=90")
    assert (status, body[:4], headers["content-type"]) == (200, b"\x89PNG", "image/png")
    for query in ("n=8", "n=-1", "n=x", "", "n=0&black=x"):
        status, body, _ = client.ask(f"frame?{query}")
        assert status == 400
        assert "frame" in json.loads(body)["error"]


def test_settings_are_checked_with_the_labels_of_the_form(client: Client) -> None:
    assert client.post("check", {"fields": {"fps": "36000"}})["toml"].splitlines()[1:] == ["fps = 36000", 'map = "off"']
    found = client.post("check", {"fields": {"mass_g": "110"}})
    assert found["error"].startswith("Mass of the ball was given without a scale")
    assert set(found["fields"]) == {"mass_g", "diameter_mm", "mm_per_px"}


def test_a_circle_is_found_fitted_and_unrolled(client: Client, demo_shot: demo.Shot) -> None:
    found = client.post("find", {})
    assert (found["frame"], found["others"]) == (0, [])
    # Three standard deviations of the circle of a few frames.
    assert found["x"] == pytest.approx(demo_shot.position[0, 0], abs=0.3)
    fitted = client.post("fit", {"x": 66, "y": 92, "radius": 41, "frame": 0})
    assert fitted["radius"] == pytest.approx(demo.RADIUS_PX, abs=0.4)
    edge = client.get("edge?x=64.3&y=92.6&radius=40&frame=0")
    assert len(edge["steps"]) == len(edge["mean"])
    assert (
        "no outline was found"
        in client.post("fit", {"x": 230, "y": 60, "radius": 20, "frame": 0}, 400)["error"].lower()
    )
    assert "draw it again" in client.post("fit", {"x": 1}, 400)["error"]
    assert client.ask("edge?x=nan&y=1&radius=1&frame=0")[0] == 400


def wait_for_end(session: Session) -> None:
    assert session.job is not None
    session.job.wait(120)


def test_a_measurement_is_begun_watched_and_its_result_alone_is_served(
    client: Client, session: Session, demo_shot: demo.Shot
) -> None:
    places = session.places
    assert client.get("progress") == {"state": "none"}
    assert client.ask("result/summary.json")[0] == 404
    x, y = demo_shot.position[0]
    sent = {"circle": {"x": x, "y": y, "radius": demo.RADIUS_PX, "frame": 0}, "fields": {"fps": "36000"}}
    assert client.post("track", sent)["state"] == "running"
    wait_for_end(session)
    found = client.get("progress?version=-1&since=0")
    assert found["state"] == "done"
    assert len(found["rows"]) == 8
    assert found["hasReport"]
    status, body, headers = client.ask("result/report.html")
    assert status == 200
    assert b"<title>short.tif" in body
    assert headers["content-type"].startswith("text/html")
    assert client.ask("result/figures/motion.png")[2]["content-type"] == "image/png"
    assert client.ask("result/track.parquet")[2]["content-disposition"] == "attachment"
    (places.out / "out").symlink_to(places.input)
    for name in ("", ".", "..", "../shot.toml", "..%2fshot.toml", "figures", "figures/../../shot.toml", "%2fetc/passwd",
                 "out", "figures//motion.png", "a%00b", "..%5cshot.toml", "nothing.csv"):  # fmt: skip
        assert client.ask(f"result/{name}")[0] == 404, name


def test_an_earlier_result_is_replaced_only_if_it_was_ticked_or_this_page_wrote_it(
    client: Client, session: Session
) -> None:
    out = session.places.out
    session.base["report"] = False
    out.mkdir()
    (out / "summary.json").write_text("{}")
    circle = {"x": 64.3, "y": 92.6, "radius": 40, "frame": 0}
    refusal = client.post("track", {"circle": circle}, 400)["error"]
    assert "tick 'Replace earlier files'" in refusal
    assert (out / "summary.json").read_text() == "{}"
    for replace in (True, False):
        client.post("track", {"circle": circle, "replace": replace})
        wait_for_end(session)
        assert client.get("progress")["state"] == "done"
        assert (out / "track.csv").is_file()


def test_a_second_measurement_waits_for_the_first(client: Client, session: Session) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def slow(*_: Any, **__: Any) -> Any:
        begun.set()
        go_on.wait(60)
        raise ValueError("enough")

    session._run = slow
    client.post("track", {})
    assert begun.wait(60)
    assert "a measurement is running" in client.post("track", {}, 400)["error"].lower()
    go_on.set()
    wait_for_end(session)
    assert client.get("progress")["sentence"] == "enough"


def test_settings_are_saved_where_the_command_said(client: Client, session: Session) -> None:
    path = session.places.config
    assert client.post("save", {"fields": {"fps": "36000"}}) == {"path": str(path)}
    assert client.post("save", {"fields": {"fps": "10000"}}) == {"path": str(path)}
    assert "fps = 10000" in path.read_text()


def test_settings_of_others_are_not_replaced_unasked(client: Client, session: Session) -> None:
    session.places.config.write_text("mine")
    assert "tick 'Replace earlier files'" in client.post("save", {}, 400)["error"]
    assert session.places.config.read_text() == "mine"
    client.post("save", {"replace": True})
    assert session.places.config.read_text() != "mine"


def test_a_port_in_use_is_refused_in_one_sentence(session: Session) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=rf"--port {port}: is used by another program; give another port"):
            PickServer(session, port)


def test_a_page_that_is_loaded_again_goes_on_where_it_was(client: Client, session: Session, tmp_path: Path) -> None:
    sent = {"fields": {"fps": "36000"}, "frames": [1, 5], "circle": None, "ignore": []}
    client.post("check", sent)
    assert session.page_data()["sent"] == sent
