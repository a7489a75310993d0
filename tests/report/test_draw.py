"""Figures and report from a result folder alone, and figures from a second process."""

import json
import multiprocessing
import shutil
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from pathlib import Path

import pytest
import tifffile

from torchsphere import measure as measuring
from torchsphere.cli.main import main
from torchsphere.measure import Measurement, Request, measure
from torchsphere.report import draw
from torchsphere.results.reader import ResultFolder
from torchsphere.runtime import threads
from torchsphere.synthetic import demo_shot

CIRCLE = (170.3, 98.6, 40.0)

FIGURES = ("motion", "rotation", "quality", "path", "residuals")


@pytest.fixture
def idle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Report an idle core, whatever the machine."""
    monkeypatch.setattr(threads, "has_idle_cores", lambda: True)


@pytest.fixture(scope="module")
def alone(short: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A result whose figures this process drew."""
    out = tmp_path_factory.mktemp("alone") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(threads, "has_idle_cores", lambda: False)
        yield tracked(short, out)


def tracked(short: Path, out: Path) -> Path:
    measure(Request(input=short, out=out, fps=36_000.0, diameter_mm=30.0, circle=CIRCLE, map="off"))
    return out


def contents(folder: Path) -> dict[str, object]:
    """All files by name; the summary without its time."""
    found: dict[str, object] = {
        str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }
    return found | {"summary.json": json.loads((folder / "summary.json").read_text()) | {"seconds": None}}


def refuse(*_: object) -> None:
    raise AssertionError("drawn by the process that measures")


@pytest.mark.usefixtures("idle")
def test_with_idle_cores_a_second_process_draws_the_same_files(
    short: Path, alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(draw.motion_figures, "motion_figure", refuse)
    assert contents(tracked(short, tmp_path / "out")) == contents(alone)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert not multiprocessing.active_children()


@pytest.mark.usefixtures("idle")
def test_this_process_draws_the_figures_of_a_process_that_dies(
    short: Path, alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = []

    def kill(pool: Executor | None, function: Callable[..., object], *arguments: object) -> object:
        for child in multiprocessing.active_children():
            child.kill()
            killed.append(child)
        return begin(pool, function, *arguments)

    begin = draw.begin
    monkeypatch.setattr(draw, "begin", kill)
    assert contents(tracked(short, tmp_path / "out")) == contents(alone)
    assert killed


@pytest.mark.usefixtures("idle")
def test_an_error_leaves_no_process_and_no_folder(short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "no space left on device", "frames.npz")

    monkeypatch.setattr("torchsphere.results.sampled_frames.save", full)
    with pytest.raises(OSError, match="no space left"):
        tracked(short, tmp_path / "out")
    assert not list(tmp_path.iterdir())
    assert not multiprocessing.active_children()


# The memory of the process is additional, and long recordings need all memory.
@pytest.mark.usefixtures("idle")
def test_a_long_recording_is_drawn_without_the_process(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measuring, "PARALLEL_DRAWING_FRAMES", 7)
    monkeypatch.setattr(draw, "ProcessPoolExecutor", refuse)
    assert (tracked(short, tmp_path / "out") / "report.html").is_file()


def test_an_invalid_folder_is_refused_with_and_without_the_process(tmp_path: Path) -> None:
    with draw.drawing_process() as pool, pytest.raises(ValueError, match="no result folder"):
        draw.draw(tmp_path, pool)
    assert not list(tmp_path.iterdir())


def test_report_draws_the_same_files_from_the_folder_alone_and_changes_no_number(
    measured: tuple[Path, Measurement], tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(measured[0], copy)
    drawn = [copy / "report.html", *(copy / "figures").iterdir()]
    assert {path.name for path in drawn} == {
        "report.html",
        "thumbnail.webp",
        *(f"{name}.{kind}" for name in (*FIGURES, "force_path") for kind in ("png", "pdf")),
    }
    before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
    for path in drawn:
        path.unlink()
    assert main(["report", str(copy), "--quiet"]) == 0
    assert {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()} == before


def test_a_report_that_fails_half_way_leaves_the_earlier_one(
    measured: tuple[Path, Measurement], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(measured[0], copy)
    before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}

    def full(_: ResultFolder) -> str:
        raise OSError(28, "no space left on device", "report.html")

    monkeypatch.setattr(draw.pages, "report_html", full)
    assert main(["report", str(copy)]) == 1
    assert "no space left" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()} == before


def test_a_report_can_be_left_out_and_drawn_later_without_images(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "shot.tif", demo_shot.make_shot().images[:4], photometric="minisblack")
    arguments = ["track", str(tmp_path / "shot.tif"), "--out", str(tmp_path / "out"), "--circle", "64.3,92.6,40"]
    assert main([*arguments, "--no-report", "--quiet"]) == 0
    names = {"track.csv", "track.parquet", "summary.json"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    assert main(["report", str(tmp_path / "out"), "--quiet"]) == 0
    text = (tmp_path / "out" / "report.html").read_text()
    assert "No images are shown" in text
    assert "Lengths are in px" in text
    assert {path.name for path in (tmp_path / "out" / "figures").iterdir()} == {
        f"{name}.{kind}" for name in FIGURES[:3] for kind in ("png", "pdf")
    }
