"""The painted pattern: size, coverage, contrast, and no trace of its construction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from render.pattern import Mark, Pattern, albedo, chart, half_correlation

RADIUS = 15.0


def sphere(count, seed=0):
    """Random unit vectors and a random direction across each."""
    rng = np.random.default_rng(seed)
    points, across = rng.normal(size=(2, count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    across -= (across * points).sum(axis=1, keepdims=True) * points
    return points, across / np.linalg.norm(across, axis=1, keepdims=True)


def correlation(pattern, points, across, distance_mm):
    """Correlation of the albedos at points and at points `distance_mm` (straight) across from them."""
    angle = 2 * np.arcsin(distance_mm / RADIUS / 2)
    moved = np.cos(angle) * points + np.sin(angle) * across
    return np.corrcoef(albedo(pattern, points, RADIUS), albedo(pattern, moved, RADIUS))[0, 1]


@pytest.mark.parametrize(("sharpness", "coverage"), [(0.7, 0.5), (3.0, 0.5), (30.0, 0.3)])
def test_the_autocorrelation_is_half_at_half_the_speckle_size(sharpness, coverage):
    points, across = sphere(20000)
    found = []
    for seed in range(4):
        pattern = Pattern(speckle_mm=1.2, sharpness=sharpness, coverage=coverage, seed=seed)
        found.append(correlation(pattern, points, across, 0.6))
    # About 2000 speckles a ball, four balls: 0.01.
    assert np.mean(found) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("coverage", [0.2, 0.5, 0.8])
def test_coverage_is_the_share_of_dark(coverage):
    points, _ = sphere(20000)
    paint = albedo(Pattern(speckle_mm=0.8, coverage=coverage, darkest=0.1, brightest=0.9), points, RADIUS)
    assert (0.9 - paint.mean()) / 0.8 == pytest.approx(coverage, abs=0.03)
    assert paint.min() >= 0.1 - 1e-12
    assert paint.max() <= 0.9 + 1e-12


def test_the_pattern_is_alike_at_the_poles_and_in_all_directions():
    pattern = Pattern(speckle_mm=1.0, seed=2)
    points, _ = sphere(200000)
    axis = np.array([0.0, 0.0, 1.0])
    east = np.cross(axis, points)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(points, east)
    found = []
    for near_pole in (True, False):
        here = (abs(points[:, 2]) > 0.9) == near_pole
        found += [correlation(pattern, points[here], way[here], 0.5) for way in (east, north)]
    # Only 300 speckles lie near the poles.
    np.testing.assert_allclose(found, 0.5, atol=0.08)


def test_contrast_draws_both_albedos_to_their_middle():
    points, _ = sphere(500)
    full, half = (albedo(Pattern(contrast=contrast), points, RADIUS) for contrast in (1.0, 0.5))
    middle = (0.08 + 0.85) / 2
    np.testing.assert_allclose(half - middle, (full - middle) / 2, atol=1e-12)


def test_sharper_edges_leave_less_grey():
    points, _ = sphere(5000)
    grey = []
    for sharpness in (1.0, 5.0, 50.0):
        paint = albedo(Pattern(sharpness=sharpness, darkest=0.0, brightest=1.0), points, RADIUS)
        grey.append(((paint > 0.1) & (paint < 0.9)).mean())
    assert grey[0] > 2 * grey[1] > 10 * grey[2]


def test_the_seed_alone_decides():
    points, _ = sphere(1000)
    one, same, other = (albedo(Pattern(seed=seed), points, RADIUS) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.15


def test_marks_are_painted_over_plain_paint():
    pattern = Pattern(
        kind="plain", brightest=0.8, marks=(Mark(direction=(0.0, 3.0, 0.0), diameter_mm=2.0, albedo=0.2),)
    )  # At the centre, one standard deviation (a quarter of the diameter) away, and far away.
    angle = 2 * np.arcsin(0.5 / RADIUS / 2)
    points = np.array([[0.0, 1.0, 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, -1.0, 0.0]])
    np.testing.assert_allclose(albedo(pattern, points, RADIUS), [0.2, 0.8 - 0.6 * np.exp(-0.5), 0.8], atol=1e-12)


def test_the_chart_gives_the_albedo_also_across_its_seam_and_its_poles():
    pattern = Pattern(speckle_mm=2.0, sharpness=1.0)
    found = chart(pattern, RADIUS, 60.0)
    rows = found.albedo.shape[0] - 2 * found.pad
    ring = np.linspace(0, 2 * np.pi, 500)
    near_pole = [
        np.stack([s * np.cos(ring), s * np.sin(ring), c * np.ones(500)], 1) for s, c in ((1e-3, 1), (3e-3, -1))
    ]
    near_seam = np.stack([np.ones(500), np.linspace(-2e-3, 2e-3, 500), np.linspace(-1, 1, 500)], axis=1)
    points = np.concatenate([sphere(5000)[0], *near_pole, near_seam])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    column = np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) * found.albedo.shape[1] - 0.5
    row = np.arccos(points[:, 2]) / np.pi * rows + found.pad - 0.5
    around = np.pad(found.albedo.astype(np.float64), ((0, 0), (0, found.albedo.shape[1] + 1)), mode="wrap")
    sampled = ndimage.map_coordinates(around, [row, column % found.albedo.shape[1]], order=1)
    # Linear interpolation of speckles of 8 px between texels of a fifth of a pixel.
    np.testing.assert_allclose(sampled, albedo(pattern, points, RADIUS), rtol=0, atol=2e-3)


def test_the_correlation_at_the_half_follows_the_arcsine_law():
    # A hard cut through the middle: arcsin(rho) is half of arcsin(1) at rho = sin(pi / 4). Soft clouds have the
    # correlation of the noise.
    assert half_correlation(1e3, 0.5) == pytest.approx(np.sin(np.pi / 4), abs=2e-3)
    assert half_correlation(0.02, 0.5) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("kind", "stripes"),
        ("speckle_mm", 0.0),
        ("sharpness", -1.0),
        ("coverage", 1.0),
        ("darkest", -0.1),
        ("darkest", 0.95),
        ("brightest", 1.2),
        ("contrast", 1.5),
        ("seed", -1),
    ],
)
def test_bad_fields_are_refused_by_name(field, value):
    with pytest.raises(ValueError, match=f"^{field} = "):
        Pattern(**{field: value})


def test_bad_marks_are_refused():
    with pytest.raises(ValueError, match=r"^direction = "):
        Mark(direction=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"^diameter_mm = "):
        Mark(diameter_mm=0.0)


def test_speckle_too_fine_for_the_memory_is_refused():
    with pytest.raises(ValueError, match=r"^speckle_mm "):
        albedo(Pattern(speckle_mm=0.05), sphere(3)[0], RADIUS)
