"""Lights, paint, backdrop and still objects against formulas of optics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rendering import needs_mitsuba, picture, steady
from scipy.spatial.transform import Rotation

from render.background import Background, StillObject
from render.ball import Ball
from render.camera import Camera
from render.frames import render_radiance
from render.light import Light, Lighting
from render.pattern import Pattern
from render.scene import Quality, Setup

CAMERA = Camera(width=160, height=140)
SETUP = Setup(
    pattern=Pattern(kind="plain", brightest=0.6),
    camera=CAMERA,
    background=Background(kind="dark"),
    quality=Quality(256),
)
Y, X = np.mgrid[:140, :160]
X, Y = (X - 79.5) / 50, (Y - 69.5) / 50
INSIDE = np.hypot(X, Y) < 0.95
# Points of the ball (radius 15 mm, at the origin) at the pixels' centres; divided by 15 mm they are outward normals.
NORMALS = np.stack([X, Y, -np.sqrt(np.maximum(1 - X**2 - Y**2, 0))], axis=-1)


def lit(*lights, uniform=0.0, **parts):
    return replace(SETUP, lighting=Lighting(uniform, lights), **parts)


@needs_mitsuba
def test_flat_light_shows_the_albedo():
    image = picture(lit(uniform=0.9), steady())
    np.testing.assert_allclose(image[INSIDE], 255 * 0.6 * 0.9, rtol=1e-5)
    np.testing.assert_array_equal(image[np.hypot(X, Y) > 1.03], 0)


@needs_mitsuba
def test_a_spot_light_follows_lambert_and_the_square_of_the_distance():
    place = np.array([-0.15, -0.1, -0.2])
    image = picture(lit(Light(kind="spot", position_m=tuple(place.tolist()), level=0.8)), steady())
    way = place - 0.015 * NORMALS
    distance = np.linalg.norm(way, axis=-1)
    cosine = np.maximum((way * NORMALS).sum(axis=-1) / distance, 0)
    truth = 255 * 0.6 * 0.8 * cosine * (np.linalg.norm(place) / distance) ** 2
    # At the limb and at the shadow's edge, a pixel's mean differs from the value at its centre.
    smooth = (np.hypot(X, Y) < 0.9) & (cosine > 0.1)
    np.testing.assert_allclose(image[smooth], truth[smooth], rtol=0, atol=0.5)
    assert abs(image[INSIDE & (cosine == 0)]).max() < 3


@needs_mitsuba
def test_an_area_light_gives_its_level_at_what_it_points_at():
    lamp = Light(position_m=(0.0, 0.0, -0.2), towards_m=(0.0, 0.0, -0.015), diameter_m=0.1, level=0.7)
    # A lamp behind the start of the orthographic camera's lines of sight blocks none of them.
    image = picture(lit(lamp), steady())
    assert image[60:80, 70:90].max() == pytest.approx(255 * 0.6 * 0.7, rel=0.01)


@needs_mitsuba
def test_an_area_light_within_sight_is_refused_and_one_behind_the_lines_of_sight_is_not():
    lamp = Light(position_m=(0.0, 0.01, 0.3), towards_m=(0.0, 0.0, 0.6), diameter_m=0.005)
    camera = Camera(model="pinhole", width=160, height=140, focal_px=2000.0)
    with pytest.raises(ValueError, match=r"position_m = .* within the camera's sight"):
        picture(lit(lamp, camera=camera), steady((0.0, 0.0, 0.6)))
    aside = replace(lamp, position_m=(0.0, 0.03, 0.3))
    assert picture(lit(aside, camera=camera), steady((0.0, 0.0, 0.6)))[70, 80] > 50
    assert picture(lit(lamp), steady((0.0, 0.0, 0.6)))[70, 80] > 50
    with pytest.raises(ValueError, match=r"position_m = .* within the camera's sight"):
        picture(lit(lamp), steady())


@needs_mitsuba
def test_light_between_bodies_is_added_on_request():
    scene = Background(
        kind="dark", objects=(StillObject(centre_m=(0.022, 0.0, 0.0), size_m=(0.01, 0.06, 0.06), albedo=0.9),)
    )
    direct = picture(lit(uniform=1.0, background=scene), steady())
    bounced = picture(lit(uniform=1.0, background=scene, quality=Quality(256, bounces=3)), steady())
    facing = INSIDE & (X > 0.7)
    # On the ball's side towards the plate, the plate is dark with one bounce, and nearly white with three.
    assert direct[facing].mean() < 0.7 * 255 * 0.6
    assert 1.2 * direct[facing].mean() < bounced[facing].mean() < 255 * 0.6
    away = (abs(X + 0.85) < 0.05) & (abs(Y) < 0.2)  # the plate is below the horizon here
    np.testing.assert_allclose(direct[away], 255 * 0.6, rtol=0, atol=0.5)


@needs_mitsuba
def test_light_adds_up():
    lamp = Light(kind="spot", position_m=(0.1, -0.1, -0.2), level=0.5)
    both = picture(lit(lamp, uniform=0.3), steady())
    apart = picture(lit(lamp), steady()) + picture(lit(uniform=0.3), steady())
    np.testing.assert_allclose(both[INSIDE], apart[INSIDE], rtol=0, atol=0.5)


@needs_mitsuba
def test_the_highlight_of_gloss_lies_where_the_mirror_puts_it_and_stays_while_the_ball_turns():
    place = np.array([-0.6, -0.45, -0.8])
    setup = lit(Light(kind="spot", position_m=tuple(place.tolist())), ball=Ball(gloss=1.0, roughness=0.1))
    images = [picture(setup, steady(start=Rotation.from_rotvec(turn))) for turn in ([0, 0, 0], [1.0, -2.0, 0.5])]
    # The bisector of the directions to the lamp and to the camera (at -z).
    bisector = place / np.linalg.norm(place) + [0, 0, -1]
    bisector /= np.linalg.norm(bisector)
    matt = picture(replace(setup, ball=Ball()), steady())
    for image in images:
        shine = np.maximum(image - matt, 0)
        shine[shine < shine.max() / 2] = 0
        found = [(shine * X).sum() / shine.sum(), (shine * Y).sum() / shine.sum()]
        assert shine.max() > 50
        np.testing.assert_allclose(found, bisector[:2], atol=0.04)
    assert np.sqrt(((images[0] - images[1]) ** 2).mean()) < 1.0


@needs_mitsuba
def test_shading_stays_in_space_while_the_ball_turns():
    setup = lit(Light(kind="spot", position_m=(-0.2, 0.1, -0.2)), uniform=0.2)
    still, turned = (picture(setup, steady(start=Rotation.from_rotvec(turn))) for turn in ([0, 0, 0], [1.0, -2.0, 0.5]))
    np.testing.assert_allclose(still[INSIDE], turned[INSIDE], rtol=0, atol=1.5)


@needs_mitsuba
def test_an_occluder_hides_the_ball_and_a_target_stands_beside_it():
    occluder = StillObject(kind="box", centre_m=(-0.01, 0.0, -0.04), size_m=(0.006, 0.1, 0.002), albedo=0.2)
    target = StillObject(kind="bar", centre_m=(0.02, 0.0, 0.009), size_m=(0.006, 0.006, 0.1), albedo=0.5)
    scene = Background(level=0.4, objects=(occluder, target))
    image = picture(lit(uniform=1.0, background=scene), steady())
    # The occluder, from -13 to -7 mm, shows its albedo. So does the end of the bar, from 17 to 23 mm.
    column = image[69]
    assert column[46] == pytest.approx(255 * 0.2, abs=0.3)
    assert column[10] == pytest.approx(255 * 0.4, abs=1e-6)
    np.testing.assert_allclose(column[int(79.5 + 20 * 10 / 3)], 255 * 0.5, rtol=0.005)
    # Above the ball its left edge, at 79.5 - 130/3 = 36.17 px, covers the pixel 36 by a third.
    assert image[5, 36] == pytest.approx(255 * (0.2 / 3 + 0.4 * 2 / 3), abs=0.5)
    assert (image[[2, 137], 37:56] < 0.21 * 255).all()


@needs_mitsuba
def test_a_body_before_the_lamp_casts_its_shadow_on_the_ball():
    lamp = Light(kind="spot", position_m=(0.0, -0.3, -0.3), level=1.0)
    shade = StillObject(centre_m=(0.0, -0.1, -0.1), size_m=(0.005, 0.02, 0.02))
    bright = picture(lit(lamp), steady())
    dark = picture(lit(lamp, background=Background(kind="dark", objects=(shade,))), steady())
    assert bright[60, 80] > 100
    assert dark[60, 80] < 1


def test_the_textured_backdrop_has_its_level_contrast_and_grain():
    backdrop = Background(kind="texture", level=0.4, contrast=0.2, grain_px=8.0, seed=3).image(400, 500)
    assert backdrop.mean() == pytest.approx(0.4, abs=0.01)
    assert backdrop.std() == pytest.approx(0.08, rel=0.05)
    level = backdrop - backdrop.mean()
    for shifted in (level[4:] * level[:-4], level[:, 4:] * level[:, :-4]):
        assert shifted.mean() / level.var() == pytest.approx(0.5, abs=0.05)


@needs_mitsuba
def test_the_backdrop_stays_while_the_ball_passes():
    scene = Background(kind="texture", seed=3)
    motion = steady(velocity_m_s=(1.0, 0.0, 0.0))
    frames = list(render_radiance(lit(uniform=1.0, background=scene), motion, np.array([0.0, 0.003])))
    backdrop = 255 * scene.image(140, 160)
    left = X < -1.05
    for frame in frames:
        np.testing.assert_allclose(frame[left], backdrop[left], rtol=0, atol=1e-9)
    assert abs(frames[0] - frames[1]).max() > 50


@pytest.mark.parametrize(
    ("kind", "field", "value"),
    [
        (Light, "kind", "laser"),
        (Light, "position_m", (0.0, 1.0)),
        (Light, "towards_m", (-0.3, -0.3, -0.3)),
        (Light, "level", -1.0),
        (Light, "diameter_m", 0.0),
        (Light, "cone_deg", 90.0),
        (Lighting, "uniform", -0.1),
        (Ball, "diameter_mm", 0.0),
        (Ball, "gloss", 2.0),
        (Ball, "roughness", 0.0),
        (StillObject, "kind", "cone"),
        (StillObject, "size_m", (0.1, 0.1, 0.0)),
        (StillObject, "albedo", 1.5),
        (Background, "kind", "photo"),
        (Background, "level", -1.0),
        (Background, "grain_px", 0.5),
        (Quality, "samples", 0),
        (Quality, "bounces", 0),
    ],
)
def test_bad_fields_are_refused_by_name(kind, field, value):
    with pytest.raises(ValueError, match=f"^{field}"):
        kind(**{field: value})
