"""Every suite of the benchmark has the property in its title: motion by the truth, appearance by the images."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rendering import needs_mitsuba
from scipy import ndimage

from render import preset
from render.exposure import Shutter
from render.frames import render_frames, render_radiance
from render.outline import outline
from render.shot import Shot, seeded
from render.truth import truth
from torchsphere.benchmark.suites import NEXT_SEED, SIZES, merged, names, recipes

Array = NDArray[np.float64]

ALL = [
    *("plain", "coarse-speckle", "fast-flight", "fast-spin", "fine-speckle", "highlights", "leaving-the-frame"),
    *("lens-distortion", "long-recording", "low-light", "motion-blur", "no-speckle", "occlusion", "off-axis"),
    *("perspective", "small-ball-10", "small-ball-20", "textured-background"),
]

#: Suites in which a part of the ball is hidden in some frames.
PARTLY_HIDDEN = ("leaving-the-frame", "occlusion")

both_sizes = pytest.mark.parametrize("size", ["smoke", "standard"])


@cache
def shot(name: str, size: str = "standard") -> Shot:
    """The shot that the renderer makes of a suite."""
    recipe = recipes([name], size)[0]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"{name}.json")
        file.write_text(json.dumps({"shot": recipe.shot}), encoding="utf-8")
        return preset.load(str(file), seed=recipe.seed)


@cache
def columns(name: str, size: str = "standard") -> dict[str, Any]:
    return truth(shot(name, size))


def steps_px(name: str, size: str = "standard") -> Array:
    return np.hypot(columns(name, size)["dx_px"][1:], columns(name, size)["dy_px"][1:])


def turns_deg(name: str, size: str = "standard") -> Array:
    return np.degrees(np.linalg.norm([columns(name, size)[f"w{axis}_rad"][1:] for axis in "xyz"], axis=0))


@cache
def image(name: str, frame: int = 0, *, clean: bool = False) -> Array:
    """An image of the suite at the size standard; ``clean`` is without noise, saturation and rounding."""
    made = shot(name)
    number = frame % made.frames
    render = render_radiance if clean else render_frames
    return next(iter(render(made.setup, made.trajectory, made.times_s[[number]], numbers=[number]))).astype(float)


def from_centre(name: str, frame: int = 0) -> Array:
    """Distance (h, w) of the pixels from the ball's centre, over its radius."""
    camera, of = shot(name).setup.camera, columns(name)
    y, x = np.mgrid[: camera.height, : camera.width]
    return np.hypot(x - of["x_px"][frame], y - of["y_px"][frame]) / of["radius_px"][frame]


def test_the_suites_are_complete() -> None:
    assert names() == ALL


def test_smoke_has_few_frames_and_full_ten_times_those_of_standard() -> None:
    counts = {size: [recipe.frames for recipe in recipes(None, size)] for size in SIZES}
    assert max(counts["smoke"]) <= 24
    assert sum(counts["smoke"]) < 200
    assert all(40 <= n <= 80 for n in counts["standard"] if n != 400)
    assert counts["standard"].count(400) == 1
    assert sum(counts["full"]) == 10 * sum(counts["standard"])


def test_no_two_recordings_share_a_seed() -> None:
    seeds = [recipe.seed for recipe in recipes(None, "full")]
    assert len(set(seeds)) == len(seeds) == 10 * len(ALL)
    assert recipes(["plain"], "smoke", seed=7)[0].seed == recipes(["plain"], "smoke")[0].seed + 7
    assert max(recipe.seed for recipe in recipes(None, "smoke")) < NEXT_SEED


def test_a_seed_changes_pattern_backdrop_and_noise() -> None:
    setup = shot("plain").setup
    other = seeded(setup, 5)
    assert {other.pattern.seed, other.background.seed, other.sensor.seed, other.quality.seed} == {5}
    assert setup.pattern.seed == recipes(["plain"], "standard")[0].seed


@both_sizes
@pytest.mark.parametrize("name", ALL)
def test_the_whole_ball_is_visible_in_the_first_frame_and_in_most_suites_in_all_frames(name: str, size: str) -> None:
    visible, setup = columns(name, size)["visible"], shot(name, size).setup
    assert visible[0] == 1
    if name in PARTLY_HIDDEN:
        assert visible.min() < 1
        return
    assert (visible == 1).all()
    for centre in shot(name, size).trajectory(shot(name, size).times_s).position_m:
        edge = outline(setup.camera, centre, setup.ball.radius_m)
        # The region of a tracker extends a little beyond the outline.
        assert edge.min() > 4
        assert (edge < [setup.camera.width - 5, setup.camera.height - 5]).all()


@both_sizes
def test_plain_is_a_ball_of_50_px_that_moves_and_turns_a_little(size: str) -> None:
    assert columns("plain", size)["radius_px"] == pytest.approx(50.0)
    assert steps_px("plain", size) == pytest.approx(5.305, abs=0.001)
    assert turns_deg("plain", size) == pytest.approx(np.sqrt(0.33), abs=1e-6)


@both_sizes
def test_fast_spin_turns_8_deg_per_frame(size: str) -> None:
    assert turns_deg("fast-spin", size) == pytest.approx(8.0, abs=0.01)


@both_sizes
def test_fast_flight_moves_by_half_a_radius_per_frame(size: str) -> None:
    assert (steps_px("fast-flight", size) > 0.5 * columns("fast-flight", size)["radius_px"][1:] - 1e-6).all()


@both_sizes
def test_motion_blur_moves_more_than_3_px_while_the_shutter_is_open(size: str) -> None:
    made = shot("motion-blur", size)
    moved = steps_px("motion-blur", size) * made.setup.shutter.exposure_s * made.frame_rate_hz
    assert moved == pytest.approx(4.8, abs=0.01)
    # The renderer's limit for a continuous blur, and the paper's limit in section 3.3.
    assert (moved / made.setup.shutter.subframes <= 0.301).all()
    assert (moved < 5).all()


@needs_mitsuba
def test_motion_blur_reduces_contrast_along_the_motion() -> None:
    made = shot("motion-blur")
    frozen = dataclasses.replace(made.setup, shutter=Shutter())
    sharp = next(render_radiance(frozen, made.trajectory, np.zeros(1)))
    inside = from_centre("motion-blur") < 0.8
    along, across = (
        np.gradient(image("motion-blur", clean=True), axis=axis)[inside].std()
        / np.gradient(sharp, axis=axis)[inside].std()
        for axis in (1, 0)
    )
    assert along < 0.6
    assert across > 0.7


@needs_mitsuba
def test_low_light_has_22_grey_levels_and_noise_of_2_6() -> None:
    inside = from_centre("low-light") < 0.9
    clean, noisy = image("low-light", clean=True), image("low-light")
    dark, bright = np.percentile(clean[inside], (1, 99))
    assert bright - dark == pytest.approx(22, abs=2)
    assert (noisy - clean)[inside].std() == pytest.approx(2.6, abs=0.1)
    assert noisy[inside].mean() < 30


@pytest.mark.parametrize(("name", "radius"), [("small-ball-10", 10.0), ("small-ball-20", 20.0)])
def test_small_balls_have_the_radius_in_their_name(name: str, radius: float) -> None:
    assert columns(name)["radius_px"] == pytest.approx(radius)
    setup = shot(name).setup
    # Speckles below two pixels are not resolved.
    assert setup.pattern.speckle_mm * setup.camera.scale_px_per_mm > 2


@needs_mitsuba
@pytest.mark.parametrize("frame", [0, -1])
def test_highlights_saturate_about_a_tenth_of_the_ball(frame: int) -> None:
    inside = from_centre("highlights", frame) < 0.9
    assert 0.05 < (image("highlights", frame)[inside] == 255).mean() < 0.15


@needs_mitsuba
def test_highlights_stand_still_while_the_pattern_turns() -> None:
    # A ball that is almost black and without a pattern shows the reflected lamps alone.
    made = shot("highlights")
    dark = merged(preset.table(made), {"pattern": {"kind": "plain", "brightest": 0.08}})
    setup = preset.build(type(made.setup), {name: dark[name] for name in ("ball", "pattern", "lighting", "sensor")})
    assert setup.ball.gloss == 1
    inside = from_centre("highlights") < 0.5
    shown = next(render_radiance(setup, made.trajectory, np.zeros(1)))
    assert shown[inside].max() > 200
    # In the suite the lamps are brighter than the dark speckles, too.
    assert image("highlights", clean=True)[shown > 200].min() > 180


@both_sizes
def test_occlusion_hides_a_third_of_the_ball(size: str) -> None:
    visible = columns("occlusion", size)["visible"]
    # A post of 26.7 px over a disc of 100 px hides 33.6 % in the middle; no frame has the post exactly there.
    assert visible.min() == pytest.approx(1 - 0.336, abs=0.008)
    assert (visible < 0.95).sum() >= 4


def test_occlusion_begins_and_ends_with_the_whole_ball() -> None:
    visible = columns("occlusion")["visible"]
    assert (visible[:8] == 1).all()
    assert (visible[-8:] == 1).all()


@needs_mitsuba
def test_occlusion_casts_a_shadow_on_the_ball() -> None:
    frame = int(columns("occlusion")["visible"].argmin())
    made = shot("occlusion")
    table = preset.table(made)
    free = preset.build(
        type(made.setup), {name: table[name] for name in ("ball", "pattern", "camera", "lighting", "sensor", "quality")}
    )
    without = next(render_radiance(free, made.trajectory, made.times_s[[frame]], numbers=[frame]))
    right = (from_centre("occlusion", frame) < 0.9) & (np.arange(384) > 220)
    darker = (image("occlusion", frame, clean=True) / without)[right]
    # Half of the light is from the lamp, and the post hides a part of the lamp.
    assert np.percentile(darker, 10) < 0.85
    assert np.percentile(darker, 90) > 0.95


@both_sizes
def test_perspective_has_the_camera_at_ten_radii(size: str) -> None:
    assert columns("perspective", size)["z_m"] / 0.015 == pytest.approx(10.0)
    assert shot("perspective", size).setup.camera.distortion == (0, 0, 0)


def test_perspective_changes_the_viewing_direction_by_30_deg() -> None:
    of = columns("perspective")
    direction = np.degrees(np.arctan(of["x_m"] / of["z_m"]))
    assert direction[-1] - direction[0] > 30


@both_sizes
def test_off_axis_has_the_ball_14_to_35_deg_from_the_axis(size: str) -> None:
    of = columns("off-axis", size)
    angle = np.degrees(np.arctan(np.hypot(of["x_m"], of["y_m"]) / of["z_m"]))
    assert angle.min() > 14
    assert angle.max() < 35
    if size == "standard":
        assert angle.max() > 34
    made = shot("off-axis", size)
    position = made.trajectory(made.times_s).position_m[-1]
    edge = outline(made.setup.camera, position, 0.015)
    width, height = np.ptp(edge, axis=0)
    # For a distant ball at the angle a, the outline is longer by 1 / cos(a) towards the axis.
    assert width / height > 0.99 / np.cos(np.radians(angle[-1])) > 1.03


def test_lens_distortion_bends_the_corner_by_9_px_and_the_path_of_the_ball() -> None:
    camera, of = shot("lens-distortion").setup.camera, columns("lens-distortion")
    corner = np.hypot(255.5, 127.5)
    distorted = camera.project(np.array([[255.5, 127.5, 2000.0]]))[0] - camera.centre_px
    assert corner - np.hypot(*distorted) == pytest.approx(8.7, abs=0.1)
    straight = 255.5 + 2000.0 * of["x_m"] / of["z_m"]
    assert np.abs(of["x_px"] - straight).max() > 2
    assert np.abs(of["x_px"] - straight).min() < 0.05
    # The distance in radii is large, so that the perspective alone is small.
    assert of["z_m"] / 0.015 == pytest.approx(40.0)


@needs_mitsuba
def test_textured_background_is_still_and_not_noise() -> None:
    outside = (from_centre("textured-background") > 1.3) & (from_centre("textured-background", -1) > 1.3)
    first, last = (image("textured-background", frame)[outside] for frame in (0, -1))
    assert first.std() == pytest.approx(0.25 * 0.3 * 255, rel=0.1)
    assert np.corrcoef(first, last)[0, 1] > 0.97
    assert (first - last).std() < 3.2  # noise of 2 grey levels in both


@both_sizes
def test_leaving_the_frame_goes_from_the_whole_ball_to_none(size: str) -> None:
    visible = columns("leaving-the-frame", size)["visible"]
    assert visible[0] == 1
    assert visible[-1] == 0
    assert (np.diff(visible) <= 0).all()
    assert ((visible > 0) & (visible < 1)).sum() >= 3


def test_long_recording_turns_the_ball_once_around_in_400_frames() -> None:
    assert turns_deg("long-recording").sum() > 360
    assert len(turns_deg("long-recording")) == 399


@pytest.mark.parametrize(("name", "size_px"), [("coarse-speckle", 12.0), ("fine-speckle", 2.0), ("plain", 4.0)])
@needs_mitsuba
def test_speckles_have_the_stated_size(name: str, size_px: float) -> None:
    setup = shot(name).setup
    assert setup.pattern.speckle_mm * setup.camera.scale_px_per_mm == pytest.approx(size_px)
    # Width of the autocorrelation at the ball's centre, where the surface is parallel to the image.
    x, y = round(columns(name)["x_px"][0]), round(columns(name)["y_px"][0])
    patch = image(name, clean=True)[y - 32 : y + 32, x - 32 : x + 32]
    power = np.abs(np.fft.fft2(patch - patch.mean())) ** 2
    correlation = np.fft.ifft2(power).real / power.mean()
    across = (correlation[0, :32] + correlation[:32, 0]) / 2
    half = np.interp(-0.5, -across[: int((across < 0.5).argmax()) + 1], np.arange(int((across < 0.5).argmax()) + 1))
    # The pixel and the optics' blur of 0.5 px increase the width, most for fine speckle.
    assert 0.75 * size_px < 2 * half < 1.2 * size_px + 0.8


@needs_mitsuba
def test_no_speckle_has_only_shading_and_noise() -> None:
    inside = from_centre("no-speckle") < 0.8
    shown = image("no-speckle")
    grain = shown - ndimage.gaussian_filter(shown, 3.0)
    assert grain[inside].std() < 2.3  # the noise of 2 grey levels, and the renderer's
    assert np.ptp(ndimage.gaussian_filter(shown, 3.0)[inside]) > 30
