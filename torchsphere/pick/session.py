"""What one page works on: the recording, the settings it began with, the files it writes, and its measurement."""

from __future__ import annotations

import base64
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchsphere.geometry.circle import Circle
from torchsphere.measure import Measurement, measure
from torchsphere.pick import form, outline
from torchsphere.pick.footage import Footage
from torchsphere.pick.form import FORM, Choice
from torchsphere.pick.refusal import on_page
from torchsphere.pick.tracking_job import TrackingJob
from torchsphere.recording import Recording
from torchsphere.recording.frame_range import resolve_range
from torchsphere.recording.ignore_mask import read_ignore
from torchsphere.report.figure_style import STATUS_COLOURS
from torchsphere.request import Request
from torchsphere.results import atomic_output
from torchsphere.runtime.shown_text import shown


@dataclass(frozen=True)
class Places:
    """The files of a session."""

    input: Path  # recording
    out: Path  # result folder
    config: Path  # TOML file


class Session:
    """One recording on one page."""

    def __init__(
        self,
        recording: Recording,
        places: Places,
        base: Mapping[str, Any] | None = None,
        run: Callable[..., Measurement] = measure,
    ) -> None:
        """Begin with the settings ``base``; raises ValueError for a range of frames that the recording lacks."""
        self.footage, self.places, self.base = Footage(recording), places, dict(base or {})
        self.range = resolve_range(self.base.get("frames", (None, None)), len(recording))
        self._run, self._lock = run, threading.Lock()
        # Fits and searches take the processor: one of each kind at a time, however often a page asks.
        self._fitting, self._finding, self._search = threading.Lock(), threading.Lock(), 0
        self._written: set[Path] = set()
        self.job: TrackingJob | None = None
        # What the page sent last: a page that is loaded again goes on from there.
        self.sent: Mapping[str, Any] | None = None
        self.found: dict[str, Any] | None = None

    def page_data(self) -> dict[str, Any]:
        """What the page's script begins with."""
        start, stop = self.range
        count, height, width = self.footage.recording.shape
        circle = self.base.get("circle")
        black, white = self.footage.levels
        return {
            "count": count,
            "width": width,
            "height": height,
            "black": black,
            "white": white,
            "deepest": _deepest(self.footage),
            "frames": [start, stop - 1],
            "circle": None if circle is None else dict(zip(("x", "y", "radius"), circle, strict=True), frame=start),
            "ignore": list(self.base.get("ignore", ())),
            "frameRate": self.footage.recording.frame_rate,
            "statuses": [{"name": name.replace("_", " "), "colour": paint} for name, paint in STATUS_COLOURS.items()],
            "sent": self.sent,
            "found": self.found,
            "config": str(self.places.config),
            "out": str(self.places.out),
        }

    def form(self) -> list[dict[str, Any]]:
        """The form by its headings: label, unit, hint, placeholder and first text of each field."""
        stated = {"fps": self.footage.recording.frame_rate, "shutter_us": self._stated_exposure_us()}
        return [
            {
                "heading": heading,
                "opened": heading == next(iter(FORM)) or any(field.name in self.base for field in fields),
                "fields": [
                    asdict(field)
                    | {
                        "switch": field.is_switch,
                        "text": form.text_of(field.name, self.base.get(field.name)),
                        "on": self.base.get(field.name) is True,
                        "stated": "" if stated.get(field.name) is None else f"{stated[field.name]:.10g}",
                    }
                    for field in fields
                ],
            }
            for heading, fields in FORM.items()
        ]

    def facts(self) -> list[str]:
        """Sentences on the recording for the head of the page."""
        recording = self.footage.recording
        count, height, width = recording.shape
        rate = "frame rate not stated" if recording.frame_rate is None else f"{recording.frame_rate:.10g} frames/s"
        return [f"{recording.kind}; {count} frames of {width} x {height} px; {rate}.", *recording.notes]

    def find(self, choice: Choice) -> dict[str, Any]:
        """The circle that a measurement of the chosen frames would find, and other round objects.

        A newer search, or `give_up`, ends it with a ValueError.
        """
        ignore = read_ignore(choice.ignore, self.footage.shape) if choice.ignore else None
        number = self.give_up()

        def check() -> None:
            if number != self._search:
                raise ValueError("the search for the ball was given up")

        with self._finding:
            found = outline.find_ball(self.footage, choice.first, choice.last + 1, ignore, check)
        self.found = _circle_data(found) | {"others": [list(other) for other in found.circle.others]}
        return self.found

    def give_up(self) -> int:
        """End a search for the ball that nobody waits for, and return the number of the next one."""
        with self._lock:
            self._search += 1
            return self._search

    def fit(self, circle: Circle) -> dict[str, Any]:
        """A drawn circle fitted to the edge near it."""
        with self._fitting:
            return _circle_data(outline.fit_circle(self.footage, circle))

    def edge(self, circle: Circle) -> dict[str, Any]:
        """The unrolled edge of a circle: bytes (a x m) from dark to bright, ray by ray, and the mean at each distance.

        A place out of the image is black.
        """
        edge = outline.unrolled_edge(self.footage, circle)
        levels = self.footage.grey(np.nan_to_num(edge.levels, nan=self.footage.levels[0]))
        mean = [None if value != value else float(f"{value:.6g}") for value in edge.mean.tolist()]
        return {
            "rays": levels.shape[0],
            "levels": base64.b64encode(levels.tobytes()).decode(),
            "steps": edge.steps.tolist(),
            "mean": mean,
        }

    def settings(self, choice: Choice) -> dict[str, Any]:
        """The settings of a choice; raises as `form.settings_of`."""
        return form.settings_of(choice, self.base, self.footage.recording.shape)

    def toml(self, choice: Choice) -> str:
        """The text of the file that `save` writes."""
        return form.toml_text(self.settings(choice), self.places.input.name)

    def save(self, choice: Choice, replace: bool) -> Path:
        """Write the settings, and return the path; raises OSError for an earlier file unless it may be replaced."""
        path = self.places.config
        text = self.toml(choice)
        with self._lock:
            form.write_toml(path, text, replace or path in self._written)
            self._written.add(path)
        return path

    def track(self, choice: Choice, replace: bool) -> TrackingJob:
        """Begin a measurement; raises ValueError or OSError where it cannot begin.

        An earlier result is replaced only if it may be, or if this session wrote it.
        """
        settings, out = self.settings(choice), self.places.out
        self.give_up()
        with self._lock:
            if self.job is not None and self.job.is_running:
                raise ValueError("a measurement is running; wait for its end, or stop it first")
            overwrite = replace or out in self._written or bool(settings.pop("overwrite", False))
            settings["overwrite"] = overwrite
            atomic_output.recover(out)
            atomic_output.check_folder(out, overwrite)
            request = Request(input=self.places.input, out=out, **settings)
            self.job = TrackingJob(request, choice.first, self._run)
            self.job.start()
            # The folder was empty, or may be replaced: what is in it later is of this session.
            self._written.add(out)
            return self.job

    def close(self) -> None:
        """Stop measurement, search and fit, and wait for their ends: nothing half-written stays.

        A process must not end while a thread of it computes.
        """
        self.give_up()
        if self.job is not None:
            self.job.stop()
            self.job.wait()
        with self._finding, self._fitting:
            self.footage.close()

    def _stated_exposure_us(self) -> float | None:
        exposure = self.footage.recording.exposure_s
        return None if exposure is None else 1e6 * exposure


def circle_of(sent: Mapping[str, Any]) -> Circle:
    """The circle that a page sent; raises ValueError for anything else."""
    try:
        x, y, radius = (float(sent[name]) for name in ("x", "y", "radius"))
        return Circle(x, y, radius, frame=int(sent["frame"]))
    except (TypeError, KeyError, ValueError, OverflowError) as error:
        raise ValueError("a circle needs x, y and a radius in px, and its frame; draw it again") from error


def title_of(places: Places) -> str:
    """The name of the recording, for the head of the page."""
    return shown(places.input.name or str(places.input))


def _deepest(footage: Footage) -> list[float]:
    """Limits of the controls of black and white: the range of the levels, and half as much on both sides."""
    black, white = footage.levels
    return [black - 0.5 * (white - black), white + 0.5 * (white - black)]


def _circle_data(found: outline.Found) -> dict[str, Any]:
    circle = found.circle
    deviations = [None if sd != sd else sd for sd in (circle.sd_x, circle.sd_y, circle.sd_radius)]
    return {
        "x": circle.x,
        "y": circle.y,
        "radius": circle.radius,
        "sd": deviations,
        "frame": circle.frame,
        "about": circle.sd_text,
        "sentences": [on_page(sentence) for sentence in found.sentences],
    }
