"""Pictures of the tutorial and of the pages about archives and `pick`: ``python -m experiments.docs_pictures``.

Renders and tracks the tutorial's shot, and photographs report, index and `pick` in headless Chromium. The PNGs in
``docs/pictures/`` have 128 colours, so that each is smaller than 200 kB. Needs the extras render and dev, and Chromium.
"""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from PIL import Image, ImageChops

from experiments.experiment import DOCS
from render import cli as render_cli
from torchsphere.cli import main as cli
from torchsphere.measure import Measurement, measure
from torchsphere.pick.server import PickServer
from torchsphere.pick.session import Places, Session
from torchsphere.recording import open_recording
from torchsphere.request import Request
from torchsphere.tracking.follow import Watch
from torchsphere.tracking.record import Record

OUT = DOCS / "pictures"

#: Width and height of the browser's window, and largest width of a picture, px.
WINDOW, KEPT_HEIGHT, WIDEST = 1180, 860, 1180

#: Frame up to which `pick` has measured, in the middle of the contact, and frame that the report shows, in flight.
SHOWN, IN_FLIGHT = 33, 14


def shoot(folder: Path) -> None:
    """Render and track the tutorial's shot in ``folder``."""
    shot, images = str(folder / "shot"), str(folder / "shot" / "frames.tif")
    render = ["frontal-impact", "--samples", "16", "--out", shot, "--quiet"]
    track = ["track", images, "--out", str(folder / "result"), "--diameter-mm", "30", "--mass-g", "110"]
    for code in (
        render_cli.main(render),
        cli.main(["info", images, "--preview", str(folder / "ball.png")]),
        cli.main([*track, "--normal-deg", "180", "--telecentric"]),
    ):
        if code != 0:
            raise RuntimeError("the tutorial's shot could not be made; see the sentence above")


def archive(folder: Path) -> None:
    """Track an archive of three recordings: an impact, a flight, and a recording without a ball."""
    images = tifffile.imread(folder / "shot" / "frames.tif")
    shots = folder / "shots"
    shots.mkdir()
    # Grey levels of the background.
    empty = np.random.default_rng(0).integers(55, 66, images[:25].shape).astype(np.uint8)
    for name, part in (("shot1", images), ("shot2", images[:25]), ("shot3", empty)):
        tifffile.imwrite(shots / f"{name}.tif", np.ascontiguousarray(part), photometric="minisblack")
    options = ["--fps", "36000", "--diameter-mm", "30", "--mass-g", "110", "--workers", "1", "--quiet"]
    if cli.main(["batch", str(shots), "--out", str(folder / "results"), *options]) != 3:
        raise RuntimeError("expected two recordings done and one failed")


def save(picture: Image.Image, name: str) -> None:
    """Save a picture without white margins, in 128 colours."""
    white = Image.new("RGB", picture.size, "white")
    left, top, right, bottom = ImageChops.difference(picture.convert("RGB"), white).getbbox() or (0, 0, *picture.size)
    right, bottom = min(right + 8, picture.width), min(bottom + 8, picture.height)
    picture = picture.crop((max(left - 8, 0), max(top - 8, 0), right, bottom))
    if picture.width > WIDEST:
        picture = picture.resize((WIDEST, round(picture.height * WIDEST / picture.width)), Image.Resampling.LANCZOS)
    few = picture.convert("RGB").quantize(128, dither=Image.Dither.NONE)
    few.save(OUT / f"{name}.png", optimize=True)
    print(f"{name}.png  {few.width} x {few.height} px, {(OUT / f'{name}.png').stat().st_size / 1e3:.0f} kB")


def photograph(address: str, act: Callable[[Any], None], target: Path) -> None:
    """Save a screenshot of the page at ``address``, after ``act`` was called with the page, as ``target``."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WINDOW, "height": KEPT_HEIGHT}, color_scheme="light")
        page.goto(address)
        page.wait_for_timeout(500)
        act(page)
        page.wait_for_timeout(300)
        if not target.is_file():
            page.screenshot(path=str(target))
        browser.close()


def photograph_pick(folder: Path) -> None:
    """Save a screenshot of `torchsphere pick` on the tutorial's shot while it is measured, as ``pick.png``."""
    images = folder / "shot" / "frames.tif"
    with open_recording(images) as recording:
        base = {"diameter_mm": 30.0, "mass_g": 110.0, "fps": 36_000.0}
        session = Session(
            recording, Places(Path("shot.tif"), folder / "picked", Path("shot.toml")), base, _slowly(images)
        )
        with PickServer(session) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()

            def act(page: Any) -> None:
                page.wait_for_selector("body[data-circle=found]")
                page.click("#fit")
                page.wait_for_selector("body[data-circle=fitted]")
                page.click("#track")
                while page.evaluate(f"torchsphere.state.frame < {SHOWN}"):
                    page.wait_for_timeout(50)
                page.evaluate("window.scrollTo(0, 0)")

            photograph(server.address, act, folder / "pick.png")
            server.shutdown()
            session.close()


def _slowly(images: Path) -> Callable[..., Measurement]:
    """`measure` of ``images`` with a pause per call, so that a picture can be taken meanwhile."""

    def run(request: Request, progress: Callable[[int, int], None], *, watch: Watch) -> Measurement:
        def watched(record: Record, done: int) -> None:
            watch(record, done)
            time.sleep(0.5 if done < SHOWN else 2.0)

        return measure(dataclasses.replace(request, input=images), progress, watch=watched)

    return run


def main() -> None:
    """Make all pictures."""
    OUT.mkdir(exist_ok=True)
    # The pictures show the relative paths of the tutorial.
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        folder = Path()
        shoot(folder)
        archive(folder)

        def seek(page: Any) -> None:
            page.evaluate(f"const s = document.querySelector('#slider'); s.value = {IN_FLIGHT};")
            page.dispatch_event("#slider", "input")

        def of_orbit(page: Any) -> None:
            seek(page)
            page.wait_for_timeout(300)
            page.locator("#orbit").screenshot(path=str(folder / "orbit.png"))

        report, index = (Path(part).absolute().as_uri() for part in ("result/report.html", "results/index.html"))
        photograph(report, seek, folder / "report.png")
        photograph(report, of_orbit, folder / "orbit.png")
        photograph(index, lambda page: None, folder / "index.png")
        photograph_pick(folder)
        for picture in ("ball", "report", "orbit", "index", "pick"):
            save(Image.open(folder / f"{picture}.png"), picture)
        for picture in ("motion", "path"):
            save(Image.open(folder / "result" / "figures" / f"{picture}.png"), picture)


if __name__ == "__main__":
    main()
