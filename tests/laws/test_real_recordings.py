"""Real recordings, if the folder of samples is present."""

from pathlib import Path

import numpy as np
import pytest

from torchsphere import Recording, Track, open_recording, track


@pytest.fixture
def photron(shared_data: Path) -> Recording:
    path = shared_data / "photron" / "ball_12bit.cihx"
    if not path.is_file():
        pytest.skip("the Photron sample is not present")
    return open_recording(path)


def test_the_photron_header_gives_rate_shutter_and_depth_with_their_origins(photron: Recording) -> None:
    assert photron.frame_rate == 30_000
    assert photron.exposure_s == pytest.approx(1 / 50_000, rel=1e-12)
    assert photron.bit_depth == 12
    assert {"frame_rate", "exposure_s", "bit_depth"} <= set(photron.origins)
    assert "recordRate" in photron.origins["frame_rate"] or "cihx" in photron.origins["frame_rate"]


def residual_from_a_parabola(measured: Track) -> np.ndarray:
    time = np.arange(len(measured.position))
    return np.stack([x - np.polyval(np.polyfit(time, x, 2), time) for x in measured.position.T], 1)


def test_the_photron_ball_without_texture_has_a_path_but_no_rotation(photron: Recording) -> None:
    measured = track(photron)
    assert (measured.status[1:] == "weak_texture").all()
    assert np.isnan(measured.increment[:, 2:]).all()
    # The diameter was read from the images by eye, to half a px.
    assert 2 * measured.circle.radius == pytest.approx(125.8, abs=0.5)
    # The path of a free ball is a parabola; the residual stays below 0.05 px.
    residual = residual_from_a_parabola(measured)
    assert np.sqrt((residual**2).mean(0)).max() < 0.05
    assert np.abs(residual).max() < 0.05
    sd = np.sqrt(measured.covariance[:, [0, 1], [0, 1]])
    assert np.isfinite(sd).all()
    assert (sd < 0.05).all()
