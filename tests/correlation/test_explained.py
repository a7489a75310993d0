"""The parts of the ball that a motion explains."""

import torch
from shots import clean, covered, noisy, pixel_grid, textured

from torchsphere import correlate
from torchsphere.correlation.explained import is_same_part
from torchsphere.correlation.result import CELLS


def half(rows: slice) -> torch.Tensor:
    cells = torch.zeros(1, CELLS, CELLS)
    cells[:, rows] = 1
    return cells


def test_a_pair_that_follows_the_other_half_does_not_follow_the_same_part() -> None:
    upper, lower = half(slice(0, CELLS // 2)), half(slice(CELLS // 2, CELLS))
    whole, quarter = half(slice(0, CELLS)), half(slice(0, CELLS // 4))
    after, before = torch.cat((upper, upper, whole, upper)), torch.cat((lower, upper, lower, quarter))
    assert is_same_part(after, before).tolist() == [False, True, True, True]


def test_the_half_that_a_still_plate_hides_is_not_explained_by_the_motion_of_the_ball() -> None:
    made = clean(n=2, radius=30.0, start=(60.0, 60.0), step=(4.0, 0.0))
    x, y = pixel_grid(made.images)
    images = covered(made.images, ((y >= 66) & (x >= 0)).float()[None], textured(5, 1.7, 45.0))
    f, g = noisy(images, 2.0, 7)
    found = correlate(f, g, made.circle, start=made.increments[0])
    assert found.status.tolist() == ["ok"]
    before, after = found.explained[0]
    # A cell is 5 px; the windows reach 3 px across the plate's edge, and the spline as far. A dozen speckles of the
    # plate match by chance here and there.
    inner = slice(2, CELLS - 2)
    for cells in (before, after):
        assert float(cells[2:5, inner].min()) > 0.9
        assert float(cells[8:].mean()) < 0.1


def test_a_motion_of_the_whole_ball_explains_all_of_it() -> None:
    made = clean(n=2, radius=30.0, start=(60.0, 60.0), step=(4.0, 0.0))
    f, g = noisy(made.images, 2.0, 7)
    assert bool((correlate(f, g, made.circle, start=made.increments[0]).explained == 1).all())
