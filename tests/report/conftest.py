"""Fixtures for the tests of reports in a browser."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from report_pages import FIRST, LAST, Opened

from torchsphere.cli.main import main
from torchsphere.report import draw
from torchsphere.runtime import threads
from torchsphere.synthetic.demo_shot import RADIUS_PX, Shot


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory, demo_shot: Shot) -> Path:
    """Results of twelve frames after the demo's impact: in SI units, in the lab frame, in px, and of a lost ball."""
    folder = tmp_path_factory.mktemp("browser")
    images = demo_shot.images[FIRST : LAST + 1].copy()
    tifffile.imwrite(folder / "shot.tif", images, photometric="minisblack")
    images[5:] = np.random.default_rng(0).integers(55, 66, images[5:].shape)
    tifffile.imwrite(folder / "gone.tif", images, photometric="minisblack")
    x, y = demo_shot.position[FIRST]
    options = ["--circle", f"{x},{y},{RADIUS_PX}", "--map", "off", "--quiet"]
    si = ["--fps", "36000", "--diameter-mm", "30", "--mass-g", "110"]
    with pytest.MonkeyPatch.context() as patch:
        # The pages show no figure, and these take most of the time.
        patch.setattr(draw, "draw_figures", lambda *_: None)
        patch.setattr(threads, "has_idle_cores", lambda: False)
        for name, source, more in (
            ("si", "shot.tif", si),
            ("lab", "shot.tif", [*si, "--lab-frame"]),
            ("px", "shot.tif", []),
            ("gone", "gone.tif", si),
        ):
            assert main(["track", str(folder / source), "--out", str(folder / name), *options, *more]) == 0
    return folder


@pytest.fixture
def open_result(browser: Any, results: Path) -> Iterator[Any]:
    pages = []

    def opener(name: str, width: int = 1280, height: int = 900, scheme: str = "light") -> Opened:
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
        opened = Opened(page, results / name)
        page.on("request", lambda request: opened.requests.append(request.url))
        page.on("console", lambda message: opened.console_messages.append(message.text))
        page.on("pageerror", lambda error: opened.console_messages.append(str(error)))
        page.goto((results / name / "report.html").as_uri())
        pages.append(opened)
        return opened

    yield opener
    for opened in pages:
        assert opened.console_messages == []
        outside = [url for url in opened.requests if not url.startswith(("file:", "data:"))]
        assert outside == []
        assert sum(url.startswith("file:") for url in opened.requests) == 1
        opened.page.close()
