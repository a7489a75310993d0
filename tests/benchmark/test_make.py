"""A benchmark is made whole or not at all, made again equal, and refused after a change."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile
from rendering import needs_mitsuba
from scipy import ndimage

from torchsphere.benchmark import make as making
from torchsphere.benchmark.folder import (
    TRUTH,
    TRUTH_COLUMNS,
    Benchmark,
    Suite,
    read_benchmark,
    read_footage,
    read_truth,
    suite_checksum,
)
from torchsphere.benchmark.make import make
from torchsphere.benchmark.suites import find, merged, recipes

#: The cheapest suite, and one with a pinhole camera.
SUITES = ["small-ball-10", "perspective"]

#: Progress while the suites were made.
PROGRESS: list[tuple[int, int]] = []


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    """Return a small benchmark, which tests do not change."""
    folder = tmp_path_factory.mktemp("made") / "benchmark"
    return make(SUITES, "smoke", folder, workers=1, progress=lambda done, total: PROGRESS.append((done, total)))


@pytest.fixture
def copied(made: Benchmark, tmp_path: Path) -> Path:
    """Return a copy of the benchmark, which tests change."""
    return Path(shutil.copytree(made.folder, tmp_path / "copy"))


def first_ball(suite: Suite) -> list[float]:
    """Projected centre and radius in the first row of the truth, px."""
    truth = read_truth(suite.folder / TRUTH)
    return [float(truth[name][0]) for name in ("x_px", "y_px", "radius_px")]


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@needs_mitsuba
def test_a_benchmark_holds_images_and_truth_of_each_suite(made: Benchmark) -> None:
    assert [suite.name for suite in made] == SUITES
    assert names_in(made.folder) == ["perspective", "small-ball-10", "suites.json"]
    for suite in made:
        footage = read_footage(suite)
        assert footage.images.shape == (suite.frames, suite.height, suite.width) == footage.images.shape
        assert footage.images.dtype == np.uint8
        assert footage.truth.position.shape == (8, 2)
        assert read_truth(suite.folder / TRUTH)["time_s"] == pytest.approx(np.arange(8) / suite.frame_rate_hz)
        assert np.linalg.det(footage.truth.orientation) == pytest.approx(1.0)
        assert footage.truth.visible.tolist() == [1.0] * 8


@needs_mitsuba
def test_a_suite_describes_camera_circle_and_ball(made: Benchmark) -> None:
    small, perspective = made.suites
    assert (small.camera, small.diameter_mm, small.frame_rate_hz) == (None, 30.0, 36_000.0)
    assert small.circle == pytest.approx(first_ball(small), abs=1e-6)
    assert small.ball == pytest.approx(small.circle, abs=2e-6)
    assert perspective.camera is not None
    assert perspective.camera.focal_px == 500.0
    assert perspective.camera.principal_px == (255.5, 127.5)
    assert made.renderer["mitsuba"]


@needs_mitsuba
def test_under_perspective_the_circle_is_the_outline_and_not_the_projected_centre(made: Benchmark) -> None:
    suite = made.suite("perspective")
    assert suite.ball == pytest.approx(first_ball(suite), abs=1e-6)
    # Pixels of the ball: the backdrop is uniform, and few speckles at the rim have its grey level.
    shown = ndimage.binary_closing(np.abs(read_footage(suite).images[0].astype(float) - 51) > 12, iterations=4)
    y, x = np.nonzero(ndimage.binary_opening(shown, iterations=3))
    assert (x.mean(), y.mean()) == pytest.approx(suite.circle[:2], abs=0.4)
    assert np.sqrt(len(x) / np.pi) == pytest.approx(suite.circle[2], abs=0.4)
    # The projected centre is 1.8 px from the outline's, and the radius at its depth 1.8 px smaller.
    assert abs(x.mean() - suite.ball[0]) > 1.3
    assert np.sqrt(len(x) / np.pi) - suite.ball[2] > 1.3


@needs_mitsuba
def test_two_benchmarks_of_separate_processes_have_equal_checksums(made: Benchmark, tmp_path: Path) -> None:
    script = (
        "import sys, pathlib; from torchsphere.benchmark.make import make;"
        f"print(make({SUITES!r}, 'smoke', pathlib.Path(sys.argv[1]), workers=2).checksum)"
    )
    again = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "again")], capture_output=True, text=True, check=True
    )
    assert again.stdout.strip() == made.checksum
    assert [s.checksum for s in read_benchmark(tmp_path / "again")] == [s.checksum for s in made]


@needs_mitsuba
def test_another_seed_makes_other_images_of_the_same_motion(made: Benchmark, tmp_path: Path) -> None:
    other = make(["small-ball-10"], "smoke", tmp_path / "other", seed=5).suites[0]
    same = made.suite("small-ball-10")
    assert other.seed == same.seed + 5
    assert other.checksum != same.checksum
    first, second = (read_footage(suite) for suite in (same, other))
    assert np.array_equal(first.truth.position, second.truth.position)
    x, y, radius = same.circle
    ball = np.hypot(*(np.mgrid[: same.height, : same.width] - np.array([y, x])[:, None, None])) < 0.8 * radius
    apart = (first.images[0].astype(float) - second.images[0])[ball]
    assert apart.std() > 30  # another pattern, not only other noise of 2 grey levels


@needs_mitsuba
def test_a_suite_that_the_renderer_refuses_leaves_nothing_behind(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text('like = "plain"\ntitle = "wrong"\nseed = 1\n[shot.camera]\nwidth = -3\n', encoding="utf-8")
    (tmp_path / "out").mkdir()
    with pytest.raises(ValueError, match=r"suite 'own': .*camera\.width = -3: expected a number of at least 1"):
        make([str(own)], "smoke", tmp_path / "out" / "benchmark")
    assert names_in(tmp_path / "out") == []


@needs_mitsuba
def test_an_earlier_benchmark_survives_a_later_one_that_fails(copied: Path, tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text('like = "plain"\ntitle = "wrong"\nseed = 1\n[shot.ball]\ngloss = 7\n', encoding="utf-8")
    with pytest.raises(ValueError, match="gloss"):
        make([str(own)], "smoke", copied, overwrite=True)
    assert names_in(tmp_path) == ["copy", "own.toml"]
    for suite in read_benchmark(copied):
        read_footage(suite)


@needs_mitsuba
def test_an_interrupted_make_ends_its_processes_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[subprocess.Popen[bytes]] = []

    def interrupted(seconds: float) -> None:
        raise KeyboardInterrupt

    def remembered(recipe: making.Recipe, folder: Path) -> subprocess.Popen[bytes]:
        started.append(start(recipe, folder))
        return started[-1]

    start = making._start_renderer
    monkeypatch.setattr(making, "_start_renderer", remembered)
    monkeypatch.setattr(making.time, "sleep", interrupted)
    with pytest.raises(KeyboardInterrupt):
        make(SUITES, "smoke", tmp_path / "benchmark", workers=2)
    assert len(started) == 2
    assert all(process.poll() is not None for process in started)
    assert names_in(tmp_path) == []


@needs_mitsuba
def test_progress_counts_frames(made: Benchmark) -> None:
    assert made.size == "smoke"
    assert PROGRESS == [(8, 16), (16, 16)]


def test_without_the_renderer_the_error_names_the_package_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(making.importlib.util, "find_spec", lambda name: None if name == "mitsuba" else object())
    with pytest.raises(ModuleNotFoundError, match=r"needs mitsuba, which is not installed: pip install 'torchsphere"):
        make(["plain"], "smoke", tmp_path / "benchmark")
    assert names_in(tmp_path) == []


@pytest.mark.parametrize(
    ("suites", "size", "options", "message"),
    [
        (["plane"], "smoke", {}, "suite = plane is not known: expected one of plain, "),
        (["none.toml"], "smoke", {}, "there is no such file"),
        (["plain"], "huge", {}, "size 'huge' is not known: expected one of smoke, standard, full"),
        (["plain", "plain"], "smoke", {}, "'plain' is given twice"),
        ([], "smoke", {}, "none is given"),
        (["plain"], "smoke", {"seed": -1}, "seed = -1: expected a whole number of at least 0"),
        (["plain"], "smoke", {"workers": 0}, "workers = 0: expected at least 1"),
    ],
)
def test_unknown_suites_sizes_and_options_are_refused(
    suites: list[str], size: str, options: dict[str, int], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        make(suites, size, tmp_path / "benchmark", **options)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("title = ", "is no TOML file"),
        ('speed = 3\nlike = "plain"', "speed is not known: expected title, like, seed"),
        ('like = "nothing"\ntitle = "x"\nseed = 1', "like = 'nothing': expected the name of another suite"),
        ('like = "plain"\ntitle = "x"', "seed = None: expected a whole number"),
        ('title = "x"\nseed = 1\nframes = { smoke = 8, standard = 40 }', "shot = None: expected a table"),
        ('like = "plain"\ntitle = "x"\nseed = 1\nframes = { smoke = 2 }', "frames.smoke = 2: expected a whole number"),
    ],
)
def test_a_file_that_is_no_suite_is_refused_with_its_name(text: str, message: str, tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=message) as caught:
        recipes([str(own)], "smoke")
    assert str(own) in str(caught.value)


def test_a_suite_takes_missing_values_from_another_suite() -> None:
    plain, spin = (recipes([name], "standard")[0].shot for name in ("plain", "fast-spin"))
    assert spin["camera"] == plain["camera"]
    assert {key for key in plain["trajectory"] if plain["trajectory"][key] != spin["trajectory"][key]} == {"spin_rev_s"}
    assert find("plain").name == "plain.toml"
    assert merged({"a": {"b": 1, "c": [1, 2]}}, {"a": {"c": [3]}}) == {"a": {"b": 1, "c": [3]}}


def test_a_suite_may_be_like_one_that_is_like_another(tmp_path: Path) -> None:
    own = tmp_path / "plain.toml"
    own.write_text('like = "small-ball-10"\ntitle = "x"\nseed = 1\n[shot.ball]\ngloss = 0.5\n', encoding="utf-8")
    mine, small, plain = (recipes([name], "standard")[0].shot for name in (str(own), "small-ball-10", "plain"))
    assert mine["ball"] == plain["ball"] | {"gloss": 0.5}
    assert mine["camera"] == small["camera"]
    assert mine["sensor"] == plain["sensor"]


def test_full_repeats_every_suite_under_separate_names() -> None:
    made = recipes(["plain"], "full")
    assert [recipe.name for recipe in made] == [f"plain.{i}" for i in range(1, 11)]
    assert {recipe.kind for recipe in made} == {"plain"}
    assert len({recipe.seed for recipe in made}) == 10


@needs_mitsuba
def test_an_existing_folder_is_not_overwritten_without_the_option(copied: Path, tmp_path: Path) -> None:
    with pytest.raises(FileExistsError, match="exists and is not empty; give another folder, or `overwrite`"):
        make(["plain"], "smoke", copied)
    other = tmp_path / "other"
    other.mkdir()
    (other / "notes.txt").touch()
    with pytest.raises(FileExistsError, match="holds files that are no benchmark"):
        make(["plain"], "smoke", other, overwrite=True)
    with pytest.raises(FileExistsError, match="is a file"):
        make(["plain"], "smoke", other / "notes.txt", overwrite=True)


def first_suite(folder: Path) -> Suite:
    return read_benchmark(folder).suites[0]


@needs_mitsuba
def test_a_changed_grey_level_is_noticed(copied: Path) -> None:
    suite = first_suite(copied)
    images = tifffile.imread(suite.images_path)
    images[3, 10, 10] ^= 1
    tifffile.imwrite(suite.images_path, images)
    with pytest.raises(
        ValueError, match=r"images or truth have the checksum sha256:.*they were changed since they were made"
    ):
        read_footage(suite)


@needs_mitsuba
def test_a_changed_truth_is_noticed(copied: Path) -> None:
    suite = first_suite(copied)
    file = suite.folder / "truth.csv"
    x = repr(read_footage(suite).truth.position[2, 0].item())
    file.write_text(file.read_text().replace(x, repr(float(x) + 1e-6)), encoding="utf-8")
    with pytest.raises(ValueError, match="images or truth have the checksum"):
        read_footage(suite)


@needs_mitsuba
def test_the_checksum_does_not_depend_on_the_compression_of_the_images(copied: Path) -> None:
    suite = first_suite(copied)
    images = tifffile.imread(suite.images_path)
    tifffile.imwrite(suite.images_path, images, compression="zlib")
    assert np.array_equal(read_footage(suite).images, images)


def test_the_checksum_covers_type_and_shape_of_the_images_and_nine_decimals_of_the_truth() -> None:
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (3, 4, 6), dtype=np.uint8)
    truth = {name: rng.uniform(-1, 1, 3) for name in TRUTH_COLUMNS}
    nearly = {name: column.round(9) + 1e-15 for name, column in truth.items()}
    assert suite_checksum(images, truth) == suite_checksum(images, nearly)
    assert suite_checksum(images, truth) != suite_checksum(images.astype(np.uint16), truth)
    assert suite_checksum(images, truth) != suite_checksum(images.reshape(3, 6, 4), truth)
    assert suite_checksum(images, truth) != suite_checksum(images, truth | {"visible": truth["visible"] + 1e-8})
    wide = images.astype(np.uint16)
    assert suite_checksum(wide, truth) == suite_checksum(wide.astype(">u2"), truth)


@needs_mitsuba
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 9}, "its version is 9, expected 1; make the benchmark again"),
        ({"size": "full"}, "its checksum does not fit its content"),
        ({"benchmark": "other"}, "it does not say that it is a benchmark of torchsphere"),
    ],
)
def test_a_changed_description_is_noticed(copied: Path, change: dict[str, object], message: str) -> None:
    file = copied / "suites.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | change), encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        read_benchmark(copied)


@needs_mitsuba
def test_a_damaged_folder_is_refused(copied: Path, tmp_path: Path) -> None:
    (suite := first_suite(copied)).images_path.write_bytes(b"no images")
    with pytest.raises(ValueError, match="is no stack of images"):
        read_footage(suite)
    (copied / "suites.json").write_text('{"benchmark": "torchsphere", "version": 1}', encoding="utf-8")
    with pytest.raises(ValueError, match="is damaged"):
        read_benchmark(copied)
    with pytest.raises(ValueError, match=r"holds no suites\.json, so it is no benchmark"):
        read_benchmark(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frame,time_s\n0,0\n", "lacks the column x_px"),
        ("frame,time_s,x_px,y_px,radius_px,qw,qx,qy,qz,visible\n0,0,1,x,3,1,0,0,0,1\n", "row without its numbers"),
        (
            "frame,time_s,x_px,y_px,radius_px,qw,qx,qy,qz,visible\n0,0,1,nan,3,1,0,0,0,1\n",
            "y_px holds a number that is",
        ),
        ("", "lacks the column frame"),
    ],
)
def test_a_truth_with_missing_columns_or_numbers_is_refused(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "truth.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        read_truth(file)


@needs_mitsuba
def test_an_unknown_suite_is_refused_with_the_known_names(made: Benchmark) -> None:
    with pytest.raises(ValueError, match="has no suite 'plain'; expected one of small-ball-10, perspective"):
        made.suite("plain")
