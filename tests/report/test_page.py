"""What is kept of a recording, read back and put into words: against the track that it came from, and exact truth."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from hypothesis import given
from hypothesis import strategies as st
from shots import pair

from torchsphere.cli.main import main
from torchsphere.correlation.options import Options
from torchsphere.correlation.result import STATUSES
from torchsphere.imaging import crop
from torchsphere.measure import Measurement, Request, measure
from torchsphere.report import draw, explanations, image_figures, report_page, summary_tables
from torchsphere.report.residual_maps import Pairs, residual_maps
from torchsphere.report.time_series import panels
from torchsphere.results.reader import ResultFolder, read
from torchsphere.results.sampled_frames import LIMIT, chosen, load, save
from torchsphere.synthetic import demo_shot

FIGURES = ("motion", "rotation", "quality", "path", "residuals")


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Measurement]:
    """Result folder and measurement of the demo's impact, frames 20 to 45."""
    folder = tmp_path_factory.mktemp("report")
    tifffile.imwrite(folder / "shot.tif", demo_shot.make_shot().images[20:46], photometric="minisblack")
    request = Request(
        input=folder / "shot.tif",
        out=folder / "result",
        fps=36_000.0,
        diameter_mm=30.0,
        mass_g=110.0,
        circle=(170.3, 98.6, 40.0),
        map="off",
    )
    return folder / "result", measure(request)


@pytest.fixture(scope="module")
def result(measured: tuple[Path, Measurement]) -> ResultFolder:
    return read(measured[0])


def test_a_result_folder_reads_back_as_what_was_measured(
    measured: tuple[Path, Measurement], result: ResultFolder
) -> None:
    track, motion = measured[1].track, measured[1].motion
    assert motion is not None
    assert result.motion is not None
    # Ten digits are written.
    np.testing.assert_allclose(result.position, track.position, rtol=1e-9)
    np.testing.assert_allclose(result.increment[1:], track.increment, rtol=1e-9)
    assert np.isnan(result.increment[0]).all()
    np.testing.assert_allclose(result.motion.force_N, motion.force_N, rtol=1e-9)
    np.testing.assert_allclose(result.motion.sd_spin_rad_s, motion.sd_spin_rad_s, rtol=1e-9)
    assert result.status.tolist() == track.status.tolist()
    assert result.contact_s == pytest.approx(motion.contact_s)


def test_turned_angles_are_sums_of_the_increments_and_end_where_one_is_missing(result: ResultFolder) -> None:
    np.testing.assert_allclose(result.turned_rad[1:], result.increment[1:, 2:].cumsum(0), atol=1e-12)
    assert (result.turned_rad[0] == 0).all()
    increment = result.increment.copy()
    increment[7] = np.nan
    broken = dataclasses.replace(result, increment=increment)
    assert np.isfinite(broken.turned_rad[:7]).all()
    assert np.isnan(broken.turned_rad[7:]).all()


def test_means_that_an_earlier_result_lacks_are_not_measured(result: ResultFolder) -> None:
    earlier = dataclasses.replace(result, summary={k: v for k, v in result.summary.items() if k != "mean_motion"})
    (rows,) = (rows for title, rows in summary_tables.sections(earlier) if title == "Mean motion")
    assert [text for _, text in rows] == [summary_tables.NOT_MEASURED] * 2


def test_the_lab_frame_turns_the_shown_angles_over_as_the_axes(result: ResultFolder) -> None:
    settings = result.summary["settings"] | {"lab_frame": True}
    lab = dataclasses.replace(result, summary=result.summary | {"settings": settings})
    here, there = (next(p for p in panels(r) if p.key == "turned").values for r in (result, lab))
    np.testing.assert_array_equal(there, here * [1, -1, -1])


@given(
    bad=st.lists(st.integers(0, 1999), max_size=1500, unique=True),
    worst=st.integers(1, 1999),
    count=st.integers(2, 2000),
)
def test_kept_frames_hold_the_ends_the_worst_and_those_not_measured(bad: list[int], worst: int, count: int) -> None:
    status = np.full(count, "ok", dtype="<U16")
    status[[i for i in bad if i < count]] = "lost"
    zncc = np.full(count, 0.99)
    zncc[worst % count] = 0.7
    rows = chosen(status, zncc)
    assert len(rows) == min(count, LIMIT)
    assert (np.diff(rows) > 0).all()
    assert {0, count - 1, worst % count} <= set(rows.tolist())
    failed = set(np.flatnonzero(status != "ok").tolist())
    if len(failed) <= LIMIT // 2:
        assert failed <= set(rows.tolist())


def test_kept_images_come_back_from_their_file_bit_for_bit(result: ResultFolder, tmp_path: Path) -> None:
    assert result.sampled is not None
    save(tmp_path / "frames.npz", result.sampled)
    again = load(tmp_path / "frames.npz")
    assert again.webp == result.sampled.webp
    assert again.box == result.sampled.box
    np.testing.assert_array_equal(again.residual, result.sampled.residual)


def test_a_kept_image_shows_the_ball_where_the_track_has_it(result: ResultFolder) -> None:
    assert result.sampled is not None
    left, top, width, _ = result.sampled.box
    image = image_figures.picture(result.sampled, 0).astype(float)
    scale = image.shape[1] / width
    rows, columns = np.indices(image.shape)
    # The ball's pattern alone varies; the background is even and the bar's edge is more than two radii away.
    x, y = (columns + 0.5) / scale + left, (rows + 0.5) / scale + top
    away = np.hypot(x - result.position[0, 0], y - result.position[0, 1])
    assert image[away < 38].std() > 50
    assert image[(away > 44) & (away < 60)].std() < 6


MOVED = (1.3, -0.4, 0.4, -0.5, 0.3)


def _pairs(scale: float = 1.0) -> tuple[torch.Tensor, torch.Tensor, Pairs]:
    radius = 50.0 * scale
    size = int(130 * scale)
    f, g, circle = pair(
        (MOVED[0] * scale, MOVED[1] * scale, *MOVED[2:]),
        radius=radius,
        centre=(63.2 * scale, 64.7 * scale),
        shape=(size, size),
    )
    motion = torch.tensor([[MOVED[0] * scale, MOVED[1] * scale, *np.radians(MOVED[2:]), 0.0]], dtype=torch.float64)
    return f, g, Pairs(f[None].float(), g[None].float(), torch.tensor([circle], dtype=torch.float64), motion)


@pytest.mark.parametrize("scale", [1.0, 2.0], ids=["each pixel", "means of pixels"])
def test_the_true_motion_leaves_next_to_nothing_whatever_gain_and_offset(scale: float) -> None:
    f, g, pairs = _pairs(scale)
    brighter = dataclasses.replace(pairs, after=1.2 * pairs.after + 7)
    still = dataclasses.replace(pairs, motion=torch.zeros(1, 6, dtype=torch.float64))
    left, scaled, unmoved = (residual_maps(p, None, Options()) for p in (pairs, brighter, still))
    # Noise-free images of a pattern of 50 grey levels: what is left is the renderer's sampling.
    assert np.nanstd(left) < 1.0
    np.testing.assert_allclose(scaled, left, atol=2e-2)
    assert np.nanstd(unmoved) > 15 * np.nanstd(left)
    assert f.shape == g.shape


def test_what_is_new_in_an_image_stands_in_the_map_where_it_was_before_and_bright_is_positive() -> None:
    _, _, pairs = _pairs()
    after = pairs.after.clone()
    # A spot on the surface point that was 12 px left of and 9 px below the centre, carried along by the motion.
    x, y = -12.0, 9.0
    s = (50.0**2 - x**2 - y**2) ** 0.5
    turn = np.radians(MOVED[2:])
    dx, dy = MOVED[0] - s * turn[1] - y * turn[2], MOVED[1] + s * turn[0] + x * turn[2]
    column, row = round(63.2 + x + dx), round(64.7 + y + dy)
    after[0, row - 1 : row + 2, column - 1 : column + 2] += 60
    found = residual_maps(dataclasses.replace(pairs, after=after), None, Options())[0]
    at = np.unravel_index(np.nanargmax(np.abs(found)), found.shape)
    middle = found.shape[0] // 2
    # To the pixel that rounding of centre and spot may cost each.
    assert abs(at[1] - middle - x) <= 1.5
    assert abs(at[0] - middle - y) <= 1.5
    assert found[at] > 20


def test_an_ignored_region_has_no_residual() -> None:
    _, _, pairs = _pairs()
    ignore = torch.zeros(130, 130, dtype=torch.bool)
    ignore[:, 80:] = True
    found = residual_maps(pairs, ignore, Options())[0]
    middle = found.shape[0] // 2
    assert np.isnan(found[:, middle + 20 :]).all()
    assert np.isfinite(found[middle, middle - 30])


@pytest.mark.parametrize(
    ("value", "sd", "unit", "text"),
    [
        (71.6234, 0.0493, "m/s", "71.623 ± 0.049 m/s"),
        (0.45654, 0.0008, "", "0.45654 ± 0.00080"),
        ([3.0, -4.0], [0.5, 0.25], "m/s", "(3.00, -4.00) ± (0.50, 0.25) m/s"),
        (40.0, None, "px", "40 px"),
        (None, None, "kN", "not measured"),
        (float("nan"), 1.0, "kN", "not measured"),
    ],
)
def test_numbers_have_the_digits_that_their_uncertainty_allows(value: object, sd: object, unit: str, text: str) -> None:
    values = summary_tables.measured(value, sd, unit)
    assert values == text


def test_runs_of_frames_are_named_by_their_ends() -> None:
    assert explanations.runs(np.array([3, 7, 8, 9, 12])) == "3, 7-9, 12"
    assert explanations.runs(np.arange(0, 20, 2), most=3) == "0, 2, 4 and 7 more runs"


def test_every_status_has_its_meaning_and_what_to_do() -> None:
    assert tuple(explanations.STATUSES) == STATUSES
    assert all(meaning and (remedy or name == "ok") for name, (meaning, remedy) in explanations.STATUSES.items())


def test_a_report_asks_nothing_from_outside_and_holds_any_name(result: ResultFolder, tmp_path: Path) -> None:
    name = "</script><script>alert(1)</script><!-- &amp; $title.tif"
    source = result.summary["input"] | {"path": f"/shots/{name}"}
    summary = result.summary | {"input": source, "warnings": [f"A warning of {name}."]}
    text = report_page.report_html(dataclasses.replace(result, summary=summary))
    assert "default-src 'none'" in text
    assert "http://" not in text
    assert "https://" not in text
    assert "alert(1)</script>" not in text
    # The data's script and the page's own, and no third.
    assert text.count("</script>") == 2
    assert "NaN" not in json.dumps(report_page.embedded({"names": name}))
    assert json.loads(report_page.embedded({"names": name})) == {"names": name}


@pytest.mark.parametrize(("corner", "ignored"), [(20.0, False), (3.0, False), (20.0, True)])
def test_crops_are_the_same_of_images_that_do_not_lie_together(corner: float, ignored: bool) -> None:
    images = torch.randn(3, 40, 50, generator=torch.Generator().manual_seed(3))
    centres = torch.tensor([[corner, 20.4], [22.0, 19.7], [25.1, 18.0]], dtype=torch.float64)
    ignore = torch.zeros(40, 50, dtype=torch.bool)
    ignore[18:22, 20:30] = ignored
    mask = ignore if ignored else None
    together, apart = crop.cut(images, centres, 9, mask), crop.cut(list(images), centres, 9, mask)
    assert torch.equal(together.images, apart.images)
    assert torch.equal(together.origin, apart.origin)
    assert (together.usable is None) == (apart.usable is None) == (corner == 20.0 and not ignored)
    if together.usable is not None and apart.usable is not None:
        assert torch.equal(together.usable, apart.usable)


def test_report_draws_the_same_from_the_folder_alone_and_touches_no_number(
    measured: tuple[Path, Measurement], tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(measured[0], copy)
    drawn = [copy / "report.html", *(copy / "figures").iterdir()]
    assert {path.name for path in drawn} == {
        "report.html",
        "thumbnail.webp",
        *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "pdf")),
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
        raise OSError(28, "No space left on device", "report.html")

    monkeypatch.setattr(draw.report_page, "report_html", full)
    assert main(["report", str(copy)]) == 1
    assert "no space left" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()} == before


def test_a_folder_that_is_no_result_or_a_damaged_one_is_refused_in_one_sentence(
    measured: tuple[Path, Measurement], tmp_path: Path, capsys
) -> None:
    assert main(["report", str(tmp_path)]) == 1
    assert "no result folder" in capsys.readouterr().err
    copy = tmp_path / "copy"
    shutil.copytree(measured[0], copy)
    for name, damage in (
        ("frames.npz", b"PK\x03\x04 cut"),
        ("summary.json", b'{"input": '),
        ("track.csv", b"a,b\n1\n"),
    ):
        kept = (copy / name).read_bytes()
        (copy / name).write_bytes(damage)
        assert main(["report", str(copy)]) == 1
        sentence = capsys.readouterr().err.strip()
        assert "damaged" in sentence
        assert "\n" not in sentence
        (copy / name).write_bytes(kept)


def test_a_result_that_lacks_frames_or_a_section_is_told_from_a_whole_one(
    measured: tuple[Path, Measurement], tmp_path: Path, capsys
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(measured[0], copy)
    summary = json.loads((copy / "summary.json").read_text())
    tables = ("track.csv", "kinematics.csv")
    half = {name: b"".join((copy / name).read_bytes().splitlines(True)[:11]) for name in tables}
    whole = (copy / "track.csv").read_bytes()
    for name, damage, reason in (
        ("track.csv", half["track.csv"], "track.csv has 10 of the 26 frames"),
        ("kinematics.csv", half["kinematics.csv"], "kinematics.csv has 10 of the 26 frames"),
        (
            "track.csv",
            whole.replace(b",ok,", b",banana,", 1),
            "the status of frame 0 in track.csv is 'banana', and none",
        ),
        ("track.csv", whole.replace(b",ok,", b",,", 1), "the status of frame 0 in track.csv is '', and none of ok, "),
        ("summary.json", b"[]", "input"),
        ("summary.json", json.dumps(summary | {"circle": None}).encode(), "circle"),
        ("summary.json", json.dumps(summary | {"input": {"path": "shot.tif"}}).encode(), "input"),
    ):
        kept = (copy / name).read_bytes()
        (copy / name).write_bytes(damage)
        assert main(["report", str(copy)]) == 1
        sentence = capsys.readouterr().err.strip()
        assert "damaged" in sentence
        assert reason in sentence
        assert "\n" not in sentence
        (copy / name).write_bytes(kept)
    assert main(["report", str(copy / "elsewhere")]) == 1
    assert "does not exist" in capsys.readouterr().err


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


def test_a_recording_in_which_the_ball_is_lost_is_reported_in_words_and_never_as_nan(tmp_path: Path) -> None:
    images = demo_shot.make_shot().images[:8].copy()
    images[1:] = np.random.default_rng(0).integers(55, 66, images[1:].shape)
    tifffile.imwrite(tmp_path / "shot.tif", images, photometric="minisblack")
    arguments = ["track", str(tmp_path / "shot.tif"), "--out", str(tmp_path / "out"), "--circle", "64.3,92.6,40"]
    assert main([*arguments, "--fps", "36000", "--diameter-mm", "30", "--mass-g", "110", "--quiet"]) == 0
    result = read(tmp_path / "out")
    assert (
        explanations.verdict(result) == "No motion was measured: the ball was found in 1 frame of 8, but not followed."
    )
    # A circle was given: to give one is no advice.
    assert not any("--circle" in p["remedy"] for p in explanations.problems(result))
    assert any("circle that was given" in p["remedy"] for p in explanations.problems(result))
    assert sum(len(p["remedy"]) > 0 for p in explanations.problems(result)) == len(explanations.problems(result)) > 0
    text = (tmp_path / "out" / "report.html").read_text()
    assert "nan" not in text.split('id="data"')[0].lower().replace("nano", "")
    assert "not measured: no motion was measured" in text
    assert "steady motion" not in text
    assert "No impact is reported: no motion was measured." in result.summary["warnings"]
    assert not any("steady motion" in sentence for sentence in result.summary["warnings"])
