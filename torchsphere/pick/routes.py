"""The requests of a page and their answers; `server` takes care of the transport and of who may ask."""

from __future__ import annotations

import json
import mimetypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torchsphere import __version__
from torchsphere.pick.form import Choice
from torchsphere.pick.refusal import fields_of, sentence_of
from torchsphere.pick.session import Session, circle_of, title_of
from torchsphere.report import pages

#: Folder with the templates of the page.
PAGE = Path(__file__).parent / "page"

#: Types of the files in a result folder that the browser may show; all others are saved.
SHOWN_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".json": "application/json; charset=utf-8",
    ".csv": "text/csv; charset=utf-8",
    ".png": "image/png",
    ".webp": "image/webp",
    ".pdf": "application/pdf",
    ".mp4": "video/mp4",
}


@dataclass(frozen=True)
class Answer:
    """An answer to a request."""

    body: bytes
    kind: str = "application/json; charset=utf-8"
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)


def as_json(values: Mapping[str, Any], status: int = 200) -> Answer:
    """An answer in JSON, which has no NaN."""
    return Answer(json.dumps(values, allow_nan=False).encode(), status=status)


def refused(sentence: str, status: int = 400) -> Answer:
    """An answer with a sentence about what was wrong."""
    return as_json({"error": sentence}, status)


def answer(session: Session, method: str, path: str, query: Mapping[str, str], sent: Mapping[str, Any]) -> Answer:
    """The answer to a request for ``path``, without token and leading slash; ``sent`` is the body of a POST."""
    if method == "GET" and path.startswith("result/"):
        return _result_file(session, path.removeprefix("result/"))
    route = (GET if method == "GET" else POST).get(path)
    if route is None:
        return refused("there is nothing at this address", 404)
    try:
        return route(session, query, sent)
    except (ValueError, OSError) as error:
        return as_json({"error": sentence_of(error), "fields": fields_of(error)}, 400)


def _page(session: Session, query: Mapping[str, str], sent: Mapping[str, Any]) -> Answer:
    html = pages.page(
        "pick.html",
        folder=PAGE,
        title=title_of(session.places),
        grade="good",
        verdict="",
        facts=session.facts(),
        form=session.form(),
        data=session.page_data(),
        version=__version__,
    )
    return Answer(html.encode(), "text/html; charset=utf-8")


def _frame(session: Session, query: Mapping[str, str], sent: Mapping[str, Any]) -> Answer:
    try:
        frame = int(query["n"])
        black, white = (float(query[name]) if name in query else None for name in ("black", "white"))
    except (KeyError, ValueError) as error:
        raise ValueError("a frame is asked for by its number, and by grey levels for black and white") from error
    return Answer(session.footage.png(frame, black, white), "image/png")


def _progress(session: Session, query: Mapping[str, str], sent: Mapping[str, Any]) -> Answer:
    if session.job is None:
        return as_json({"state": "none"})
    try:
        version, since = int(query.get("version", -1)), int(query.get("since", 0))
    except ValueError as error:
        raise ValueError("progress is asked for by a version and a number of rows") from error
    return as_json(session.job.snapshot(version, max(since, 0)))


def _check(session: Session, query: Mapping[str, str], sent: Mapping[str, Any]) -> Answer:
    session.sent = sent
    try:
        return as_json({"toml": session.toml(_choice(session, sent))})
    except (ValueError, OSError) as error:
        # Half a number is no error of a request: a page checks while it is written.
        return as_json({"error": sentence_of(error), "fields": fields_of(error)})


def _track(session: Session, query: Mapping[str, str], sent: Mapping[str, Any]) -> Answer:
    session.sent = sent
    return as_json(session.track(_choice(session, sent), sent.get("replace") is True).snapshot())


def _stop(session: Session, query: Mapping[str, str], sent: Mapping[str, Any]) -> Answer:
    if session.job is not None:
        session.job.stop()
    return as_json({})


def _give_up(session: Session, query: Mapping[str, str], sent: Mapping[str, Any]) -> Answer:
    session.give_up()
    return as_json({})


def _choice(session: Session, sent: Mapping[str, Any]) -> Choice:
    return Choice.of(sent, session.footage.count)


Route = Callable[[Session, Mapping[str, str], Mapping[str, Any]], Answer]

GET: dict[str, Route] = {
    "": _page,
    "frame": _frame,
    "edge": lambda session, query, _: as_json(session.edge(circle_of(query))),
    "progress": _progress,
}
POST: dict[str, Route] = {
    "find": lambda session, _, sent: as_json(session.find(_choice(session, sent))),
    "give-up": _give_up,
    "fit": lambda session, _, sent: as_json(session.fit(circle_of(sent))),
    "check": _check,
    "save": lambda session, _, sent: as_json(
        {"path": str(session.save(_choice(session, sent), sent.get("replace") is True))}
    ),
    "track": _track,
    "stop": _stop,
}


def _result_file(session: Session, name: str) -> Answer:
    """A file of the result that this session wrote; no other file has an address."""
    folder = None if session.job is None else session.job.folder
    nothing = refused("there is no such file in the result", 404)
    if folder is None or "\0" in name or "\\" in name or any(part in ("", ".", "..") for part in name.split("/")):
        return nothing
    try:
        root = folder.resolve()
        path = (root / name).resolve()
        if not path.is_relative_to(root) or not path.is_file():
            return nothing
        body = path.read_bytes()
    except (OSError, ValueError):
        return nothing
    kind = SHOWN_TYPES.get(path.suffix.lower())
    if kind is not None:
        return Answer(body, kind)
    return Answer(
        body,
        mimetypes.guess_type(path.name)[0] or "application/octet-stream",
        headers={"Content-Disposition": "attachment"},
    )
