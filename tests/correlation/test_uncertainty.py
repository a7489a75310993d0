"""The stated uncertainty against the scatter of repeated measurements."""

import numpy as np
import pytest
import torch
from shots import noisy, pair

from torchsphere import correlate
from torchsphere.correlation import reference

N = 80
MOTION = (1.37, -0.22, 0.2, 0.5, 0.2)


@pytest.mark.parametrize(("model", "pre_blur", "noise"), [("rigid", 0.7, 2.0), ("finite", 0.7, 4.0)])
def test_the_scatter_of_noisy_pairs_is_the_stated_uncertainty(model: str, pre_blur: float, noise: float) -> None:
    f, g, circle = pair(MOTION)
    many_f, many_g = noisy(f.expand(N, -1, -1), noise, 3), noisy(g.expand(N, -1, -1), noise, 4)
    found = correlate(many_f, many_g, circle, model=model, pre_blur=pre_blur)
    assert (found.status == "ok").all()
    scatter = found.q.double().std(0).numpy()
    stated = found.covariance.diagonal(dim1=1, dim2=2).mean(0).sqrt().numpy()
    # The standard deviation of 80 samples is known to 1 / sqrt(2 * 79) = 8 %: 0.75 to 1.3 is three of that to either
    # side, for five numbers at once; the model of the noise is right to a tenth.
    assert np.all((scatter / stated > 0.75) & (scatter / stated < 1.3)), scatter / stated


def test_the_correlations_are_those_of_the_scatter() -> None:
    f, g, circle = pair(MOTION)
    found = correlate(noisy(f.expand(N, -1, -1), 2.0, 5), noisy(g.expand(N, -1, -1), 2.0, 6), circle)
    stated = found.covariance.mean(0)
    sd = stated.diagonal().sqrt()
    measured = torch.corrcoef(found.q.double().T)
    expected = stated / (sd[:, None] * sd)
    # x with wy and y with wx: 0.96 at 0.95 R, from 80 samples to (1 - 0.96^2) / sqrt(80) = 0.009.
    for i, j in ((0, 3), (1, 2)):
        assert abs(float(expected[i, j])) == pytest.approx(0.96, abs=0.02)
        assert float(measured[i, j]) == pytest.approx(float(expected[i, j]), abs=0.04)
    # The others are uncorrelated, known to 1 / sqrt(80) = 0.11: four of that.
    assert abs(float(measured[0, 1] - expected[0, 1])) < 0.5


def test_the_covariance_is_symmetric_positive_and_grows_with_the_noise() -> None:
    f, g, circle = pair(MOTION)
    sds = []
    for noise in (1.0, 4.0):
        covariance = correlate(noisy(f, noise, 7), noisy(g, noise, 8), circle).covariance[0]
        torch.testing.assert_close(covariance, covariance.T, atol=0, rtol=1e-9)  # rounding of float64
        assert (torch.linalg.eigvalsh(covariance) > 0).all()
        sds.append(covariance.diagonal().sqrt())
    # Four times the noise; rounding to grey levels (0.29) and interpolation add a little to the smaller one.
    ratio = sds[1] / sds[0]
    assert ((ratio > 3.0) & (ratio < 4.2)).all()


def test_a_smaller_region_has_a_larger_uncertainty() -> None:
    f, g, circle = pair(MOTION)
    f, g = noisy(f, 2.0, 9), noisy(g, 2.0, 10)
    sd = [correlate(f, g, circle, roi=roi).covariance[0].diagonal().sqrt() for roi in (0.5, 0.7, 0.9)]
    # By the operator of a uniform texture the standard deviation of x falls from 0.043 to 0.014 to 0.008 px, by 3.1 and
    # by 1.75; on any pattern at least by 1.5.
    assert (sd[0][[0, 1, 2, 3]] > 1.5 * sd[1][[0, 1, 2, 3]]).all()
    assert (sd[1][[0, 1, 2, 3]] > 1.5 * sd[2][[0, 1, 2, 3]]).all()


def test_every_second_pixel_is_as_certain_as_all(monkeypatch: pytest.MonkeyPatch) -> None:
    f, g, circle = pair(MOTION)
    f, g = noisy(f.expand(N, -1, -1), 4.0, 11), noisy(g.expand(N, -1, -1), 4.0, 12)
    half = correlate(f, g, circle)
    monkeypatch.setattr(reference, "MIN_CHESSBOARD_POINTS", 10**9)
    whole = correlate(f, g, circle)
    # The same noise in both: the ratio of the scatters is known better than either of them.
    scatter = half.q.double().std(0) / whole.q.double().std(0)
    assert ((scatter > 0.96) & (scatter < 1.04)).all(), scatter
    # The stated values agree as well: half the points have less common noise.
    stated = (half.covariance / whole.covariance).diagonal(dim1=1, dim2=2).mean(0).sqrt()
    assert ((stated > 0.96) & (stated < 1.04)).all(), stated
    assert not torch.equal(half.q, whole.q)
