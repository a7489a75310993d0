"""Windows around the ball."""

import math

import pytest
import torch
from ball_models import RADIUS, SIZE, poses, random

from torchsphere.sphere_map.window import MARGIN_PX, Windows, cut_windows

CENTRES = torch.tensor([[30.3, 29.6], [27.9, 31.2]], dtype=torch.float64)


def numbered(n: int = 2) -> torch.Tensor:
    """Images (n, h, w) in which each pixel has its own grey level."""
    return torch.arange(n * SIZE * SIZE, dtype=torch.float64).reshape(n, SIZE, SIZE)


def cut(centres: torch.Tensor, usable: torch.Tensor | None = None) -> Windows:
    return cut_windows(numbered(len(centres)), random(SIZE, SIZE), centres, RADIUS, usable)


def check_places(seen: Windows, centres: torch.Tensor) -> None:
    """Each visible pixel has the grey level of its place in its image."""
    x, y = seen.offsets(centres)
    columns, rows = (x + centres[:, :1, None]).round(), (y + centres[:, 1:, None]).round()
    expected = columns + SIZE * rows + SIZE * SIZE * torch.arange(len(centres)).reshape(-1, 1, 1)
    visible = seen.visibility > 0
    torch.testing.assert_close(seen.levels[visible], expected[visible], atol=1e-9, rtol=0)


def test_a_window_holds_the_pixels_up_to_the_margin_around_the_disc() -> None:
    seen = cut(CENTRES)
    side = 2 * (math.ceil(RADIUS + MARGIN_PX) + 1) + 1
    assert len(seen) == 2
    assert seen.levels.shape == seen.background.shape == seen.visibility.shape == (2, side, side)
    check_places(seen, CENTRES)
    # The area of a disc, to the pixels that its outline crosses.
    area = math.pi * (RADIUS + MARGIN_PX) ** 2
    assert seen.visibility.sum((1, 2)).tolist() == pytest.approx([area, area], abs=20)
    # The square has at least one pixel around these.
    for border in (seen.visibility[:, 0], seen.visibility[:, -1], seen.visibility[..., 0], seen.visibility[..., -1]):
        assert float(border.max()) == 0


def test_offsets_are_the_pixels_coordinates_less_the_centre() -> None:
    seen, at = cut(CENTRES), poses().centre
    x, y = seen.offsets(at)
    for i in range(2):
        steps = torch.arange(seen.levels.shape[-1])
        torch.testing.assert_close(x[i, 0], seen.origin[i, 0] + steps - at[i, 0], atol=1e-12, rtol=0)
        torch.testing.assert_close(y[i, :, 0], seen.origin[i, 1] + steps - at[i, 1], atol=1e-12, rtol=0)


def test_a_ball_that_leaves_the_image_has_pixels_within_the_image_alone() -> None:
    centres = torch.tensor([[5.0, 29.6], [58.3, -3.0]], dtype=torch.float64)
    seen = cut(centres)
    x, y = seen.offsets(centres)
    columns, rows = x + centres[:, :1, None], y + centres[:, 1:, None]
    inside = (columns > -0.5) & (columns < SIZE - 0.5) & (rows > -0.5) & (rows < SIZE - 0.5)
    assert float(seen.visibility[~inside.expand_as(seen.visibility)].max()) == 0
    near = x.square() + y.square() < (RADIUS + MARGIN_PX) ** 2
    assert torch.equal(seen.visibility > 0, near & inside)
    check_places(seen, centres)


def test_slices_and_places_cut_the_same_windows() -> None:
    """Windows within the image are cut as slices, all others by the places of their pixels."""
    by_slices = cut(CENTRES)
    by_places = cut(CENTRES, torch.ones(SIZE, SIZE, dtype=torch.bool))
    for name in ("levels", "background", "visibility"):
        sliced, placed = (getattr(seen, name) * by_slices.visibility for seen in (by_slices, by_places))
        torch.testing.assert_close(sliced, placed, atol=0, rtol=0)


def test_ignored_pixels_may_hold_nan() -> None:
    images, behind, usable = numbered(), random(SIZE, SIZE), torch.ones(SIZE, SIZE, dtype=torch.bool)
    usable[25:30, 28:40] = False
    images[:, ~usable], behind[~usable] = torch.nan, torch.nan
    seen = cut_windows(images, behind, CENTRES, RADIUS, usable)
    assert bool(torch.isfinite(seen.levels).all())
    assert bool(torch.isfinite(seen.background).all())
    hidden = cut(CENTRES).visibility - seen.visibility
    assert hidden.sum((1, 2)).tolist() == [60, 60]
    check_places(seen, CENTRES)


def test_rows_and_chosen_images_keep_their_pixels() -> None:
    seen = cut(torch.cat((CENTRES, CENTRES + 0.6)))
    torch.testing.assert_close(seen.take(slice(1, 3)).levels, seen.levels[1:3])
    torch.testing.assert_close(seen.take(torch.tensor([3, 0])).origin, seen.origin[[3, 0]])
    torch.testing.assert_close(
        Windows.joined([seen.take(slice(0, 1)), seen.take(slice(1, 4))]).visibility, seen.visibility
    )
