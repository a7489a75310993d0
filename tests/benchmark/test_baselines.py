"""Each baseline recovers the motion that its method models, has the known bias otherwise, and reports failures."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from shots import OBLIQUE, Shot, rotation_matrix, shot, textured, turned

from torchsphere import open_recording
from torchsphere.benchmark.baselines import TRACKERS, Baseline
from torchsphere.benchmark.baselines.lucas_kanade import rigid_fit
from torchsphere.correlation.frame_status import STATUSES
from torchsphere.geometry.circle import Circle

NEEDS = {"ecc": "cv2", "lucas_kanade": "cv2", "hough": "cv2", "phase_correlation": "skimage"}
NAMES = tuple(TRACKERS)
FRAMES = 9

#: Components of (dx, dy, wx, wy, wz) that each baseline measures.
ALL, SHIFT, SIMILARITY = (True,) * 5, (True, True, False, False, False), (True, True, False, False, True)
MEASURES = dict.fromkeys(NAMES, SHIFT) | {"lucas_kanade": ALL, "published": ALL}
MEASURES |= {"ecc": SIMILARITY, "kornia_registrator": SIMILARITY}


def tracker_or_skip(name: str):
    library = NEEDS.get(name)
    if library and importlib.util.find_spec(library) is None:
        pytest.skip(f"{name} needs {library}, which is not installed: pip install torchsphere[baselines]")
    return TRACKERS[name]


def run(name: str, made: Shot, images: torch.Tensor | None = None) -> Baseline:
    return tracker_or_skip(name)(made.images if images is None else images, made.circle)


def errors(found: Baseline, made: Shot) -> np.ndarray:
    """Measured minus true increments (n - 1, 5), px and degrees."""
    difference = found.increment - made.increments.numpy()
    difference[:, 2:] = np.rad2deg(difference[:, 2:])
    return difference


@pytest.fixture(scope="module")
def flying() -> Shot:
    return shot(1, n=FRAMES, rotation_deg=(0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def turning() -> Shot:
    return shot(0, n=FRAMES)


@pytest.fixture(scope="module")
def in_flight(flying: Shot) -> dict[str, Baseline]:
    """Return the results of baselines on the ball without rotation; `of` fills the dictionary."""
    return {}


def of(results: dict[str, Baseline], name: str, made: Shot) -> Baseline:
    if name not in results:
        results[name] = run(name, made)
    return results[name]


@pytest.mark.parametrize("name", NAMES)
def test_every_baseline_returns_the_same_kind_of_result(
    name: str, flying: Shot, in_flight: dict[str, Baseline]
) -> None:
    found = of(in_flight, name, flying)
    assert found.position.shape == (FRAMES, 2)
    assert found.increment.shape == (FRAMES - 1, 5)
    assert found.status.tolist() == ["ok"] * FRAMES
    # A component that a method does not measure is NaN, never 0.
    assert (np.isfinite(found.increment) == MEASURES[name]).all()
    np.testing.assert_allclose(np.diff(found.position, axis=0), found.increment[:, :2], atol=1e-9)
    assert found.seconds > 0
    assert found.settings["circle"] == flying.circle
    assert found.settings["method"]


#: Bounds on the mean and the standard deviation of dx and dy without rotation, px. Measured over 12 to 30 pairs: bias
#: and standard deviation 0.0003 and 0.0016 (translation), 0.001 and 0.0046 (published), 0.003 and 0.008 (ecc), 0.0003
#: and 0.006 (Lucas-Kanade), 0.0055 and 0.006 (phase), 0.0165 and 0.023 (kornia), 0.25 and 0.05 per step for Hough and
#: the outline, whose mean over 8 steps is the difference of two positions, errors of 0.15 and 0.04 px, over 8. The
#: bounds are twice that, for 8 pairs.
WITHOUT_ROTATION = {
    "translation_only": (0.002, 0.003),
    "published": (0.004, 0.009),
    "ecc": (0.008, 0.016),
    "lucas_kanade": (0.004, 0.012),
    "phase_correlation": (0.012, 0.012),
    "kornia_registrator": (0.04, 0.05),
    "hough": (0.06, 0.5),
    "edge_fit": (0.015, 0.1),
}


@pytest.mark.parametrize("name", NAMES)
def test_without_rotation_every_baseline_is_right_to_its_own_precision(
    name: str, flying: Shot, in_flight: dict[str, Baseline]
) -> None:
    found = of(in_flight, name, flying)
    error = errors(found, flying)[:, :2]
    bias, scatter = WITHOUT_ROTATION[name]
    assert np.abs(error.mean(0)).max() < bias
    assert error.std(0).max() < scatter
    # Errors of successive steps cancel: the position is as good as the sum of the mean errors.
    away = found.position - flying.centres.numpy()
    assert np.abs(away).max() < max((FRAMES - 1) * bias, 3 * scatter)


#: Mean error (x, y) in px for 0.5 deg about y and 0.2 deg about x and z per frame, and the tolerance for 8 pairs.
#: A model without the rotation measures the motion of the ball's front, R w = (-0.436, 0.175) px, weighted over the
#: region: -0.32 / +0.13 (ECC), -0.365 / +0.143 (phase) and -0.379 / +0.126 (Kornia) in an earlier
#: comparison with smaller regions. Measured here over 59 pairs: (-0.300, 0.117), (-0.293, 0.123), (-0.319, 0.125), and
#: over 12 pairs (-0.267, 0.094) for Kornia.
WITH_ROTATION = {
    "translation_only": (-0.30, 0.12, 0.03),
    "ecc": (-0.30, 0.12, 0.03),
    "phase_correlation": (-0.31, 0.12, 0.03),
    "kornia_registrator": (-0.27, 0.09, 0.04),
    # Models with the rotation, or insensitive to it. Published: 0.001 and 0.006 over 59 pairs, 0.007 and 0.011 from
    # pair to pair, slowly changing with the visible texture (the modes lack a factor). Lucas-Kanade: 0.0025 and
    # -0.0045. The last two as without rotation.
    "published": (0.0, 0.005, 0.02),
    "lucas_kanade": (0.0, 0.0, 0.01),
    "hough": (0.0, 0.0, 0.06),
    "edge_fit": (0.0, 0.0, 0.015),
}


@pytest.mark.parametrize("name", NAMES)
def test_a_rotation_outside_the_motion_model_is_measured_as_a_shift(name: str, turning: Shot) -> None:
    found = run(name, turning)
    assert found.status.tolist() == ["ok"] * FRAMES
    error = errors(found, turning)
    *expected, margin = WITH_ROTATION[name]
    assert error[:, :2].mean(0) == pytest.approx(expected, abs=margin)
    if name == "lucas_kanade":
        # Measured: bias up to 0.006 deg, standard deviation up to 0.010; twice that.
        assert np.abs(error[:, 2:].mean(0)).max() < 0.012
        assert error[:, 2:].std(0).max() < 0.02
    if name == "published":
        # Its rotation about y is too small: -0.062 of 0.5 deg, 0.010 from pair to pair.
        assert error[:, 3].mean() == pytest.approx(-0.06, abs=0.02)
    if MEASURES[name][4]:
        # Kornia's wz scatters by 0.055 deg here, ECC's by 0.011.
        assert np.abs(error[:, 4].mean()) < (0.06 if name == "kornia_registrator" else 0.015)


@pytest.mark.parametrize("name", NAMES)
def test_a_blank_frame_is_flagged_and_the_ball_is_found_again(name: str, flying: Shot) -> None:
    images = flying.images[:7].clone()
    images[3] = 90 + 2 * torch.randn(images[3].shape, generator=torch.Generator().manual_seed(1))
    found = run(name, flying, images)
    assert found.status.tolist() == ["ok", "ok", "ok", found.status[3], "lost", "ok", "ok"]
    assert found.status[3] in STATUSES[1:]
    assert np.isnan(found.position[3]).all()
    # The steps into the gap and out of the gap are not measured.
    assert np.isnan(found.increment[2:4]).all()
    assert np.isfinite(found.increment[4:, :2]).all()
    away = found.position[4:] - flying.centres[4:7].numpy()
    assert np.abs(away).max() < max(8 * WITHOUT_ROTATION[name][0], 3 * WITHOUT_ROTATION[name][1])


@pytest.mark.parametrize("name", ["hough", "edge_fit"])
def test_a_ball_without_pattern_is_followed_by_its_outline_and_missed_in_a_blank_frame(name: str) -> None:
    made = shot(4, n=6, step=(12.0, 0.4), low=200.0, high=200.0, rotation_deg=(0.0, 0.0, 0.0))
    made.images[3] = 90 + 2 * torch.randn(made.images[3].shape, generator=torch.Generator().manual_seed(1))
    found = run(name, made)
    assert found.status.tolist() == ["ok", "ok", "ok", "lost", "lost", "ok"]
    visible = [0, 1, 2, 4, 5]
    # Hough's 0.15 px and its cells as with a pattern; the outline of a plain ball is known to 0.03 px.
    bound = 0.6 if name == "hough" else 0.15
    assert np.abs((found.position - made.centres.numpy())[visible]).max() < bound


@pytest.mark.parametrize("name", NAMES)
def test_a_ball_that_has_left_the_image_has_no_position(name: str) -> None:
    made = shot(2, n=7, step=(-28.0, 0.0), start=(75.0, 120.0), rotation_deg=(0.0, 0.0, 0.0))
    found = run(name, made)
    # The centre is at -9 px in frame 3 and at -93 px in the last frame; from frame 5 on the ball is outside.
    assert found.status[1] == "ok"
    assert not {"ok", "weak_texture"} & set(found.status[5:].tolist())
    assert np.isnan(found.position[5:]).all()
    assert np.isnan(found.increment[4:]).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_sudden_step_is_found_without_a_prediction(name: str, flying: Shot) -> None:
    # The ball moves by a px, then by 20 px, which no prediction from the first step contains.
    images = torch.stack((flying.images[0], flying.images[1], flying.images[2].roll((-12, 16), (0, 1))))
    found = run(name, flying, images)
    assert found.status.tolist() == ["ok"] * 3
    true = flying.increments[1, :2].numpy() + np.array([16, -12])
    bias, scatter = WITHOUT_ROTATION[name]
    assert np.abs(found.increment[1, :2] - true).max() < bias + 3 * scatter


@pytest.mark.parametrize(("name", "bound"), [("hough", 0.6), ("edge_fit", 0.2)])
def test_outline_methods_find_the_ball_before_a_textured_background(name: str, bound: float) -> None:
    made = shot(2, n=12, step=(16.0, 0.5), rotation_deg=(0.0, 0.0, 0.0), background=textured(5, 2.0, 25.0))
    found = run(name, made)
    assert found.status.tolist() == ["ok"] * 12
    # Standard deviations of 0.14 and 0.05 px over 30 frames; four of them.
    assert np.abs(found.position - made.centres.numpy()).max() < bound


@pytest.mark.parametrize("name", ["ecc", "lucas_kanade", "phase_correlation", "hough"])
def test_twelve_bit_images_and_numpy_give_what_eight_bit_images_give(
    name: str, flying: Shot, in_flight: dict[str, Baseline]
) -> None:
    found = run(name, flying, (16 * flying.images).numpy().astype(np.uint16))
    # The images are scaled back to other 8 bit levels, which rounds them again. The bound is the baseline's own
    # scatter; Hough's result has steps of a sixth of a px.
    difference = found.increment[:, :2] - of(in_flight, name, flying).increment[:, :2]
    assert np.abs(difference).max() < WITHOUT_ROTATION[name][1]


def test_a_recording_is_read_frame_by_frame_and_progress_reported(tmp_path: Path, flying: Shot) -> None:
    images = flying.images[:4].numpy().astype(np.uint8)
    np.save(tmp_path / "shot.npy", images)
    calls: list[tuple[int, int]] = []
    tracker = tracker_or_skip("ecc")
    with open_recording(tmp_path / "shot.npy") as recording:
        lazily = tracker(recording, Circle(*flying.circle), progress=lambda done, total: calls.append((done, total)))
    np.testing.assert_array_equal(lazily.increment, tracker(images, flying.circle).increment)
    assert calls == [(2, 4), (3, 4), (4, 4)]


@pytest.mark.parametrize("name", NAMES)
def test_images_and_circles_that_cannot_be_used_are_refused(name: str, flying: Shot) -> None:
    tracker = tracker_or_skip(name)
    with pytest.raises(ValueError, match="two or more"):
        tracker(flying.images[:1], flying.circle)
    with pytest.raises(ValueError, match="outside the image"):
        tracker(flying.images, (900.0, 100.0, 50.0))
    with pytest.raises(ValueError, match="three numbers"):
        tracker(flying.images, (900.0, 100.0))
    with pytest.raises(ValueError, match="first frame"):
        tracker(flying.images, Circle(*flying.circle, frame=2))


@pytest.mark.parametrize("name", sorted(NEEDS))
def test_a_missing_library_is_named_with_the_extra_that_brings_it(
    name: str, flying: Shot, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in [m for m in sys.modules if m.partition(".")[0] == NEEDS[name]]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, NEEDS[name], None)
    with pytest.raises(ModuleNotFoundError, match=rf"{NEEDS[name]}.*pip install torchsphere\[baselines\]"):
        TRACKERS[name](flying.images, flying.circle)


@pytest.mark.parametrize("degrees", [0.0, 0.5, 20.0])
def test_the_rigid_fit_is_exact_for_points_on_a_sphere_despite_outliers(degrees: float) -> None:
    radius, generator = 50.0, np.random.default_rng(0)
    points = generator.uniform(-32, 32, (300, 2))
    surface = np.column_stack((points, -np.sqrt(radius**2 - (points**2).sum(1))))
    vector = np.deg2rad(turned(degrees, OBLIQUE))
    after = (surface @ rotation_matrix(torch.from_numpy(vector)).numpy().T)[:, :2] + (3.3, -1.7)
    after[::5] += generator.uniform(-8, 8, (60, 2))
    q, scatter, used = rigid_fit(points, after, radius)
    # Cayley's form is exact, so only the floor of the robust scale, 0.001 px, is left.
    np.testing.assert_allclose(q, [3.3, -1.7, *vector], atol=1e-6)
    assert scatter < 1e-3
    assert 230 <= used <= 250
