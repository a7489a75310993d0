"""The demo's shot: its truth in SI units, and the file that states it."""

from pathlib import Path

import numpy as np
import pytest

from torchsphere.synthetic import demo_motion, demo_shot


def test_the_true_impact_is_that_of_the_closed_form() -> None:
    true = demo_shot.true_impact()
    # 5.3 px per frame of 0.375 mm at 36 000 frames/s.
    assert true["velocity_before"][0] == pytest.approx(71.55)
    assert true["velocity_after"][0] == pytest.approx(-32.4)
    times = np.linspace(0, 70, 700_001)
    force = 0.11 * 0.375e-3 * 36_000**2 * np.linalg.norm(demo_motion.acceleration(times), axis=1)
    assert true["peak_force"] == pytest.approx(force.max(), rel=1e-9)
    assert true["impulse_size"] == pytest.approx(np.trapezoid(force, times / 36_000), rel=1e-8)
    assert true["mean_force"] == pytest.approx(true["impulse_size"] * 36_000 / 12)
    assert true["peak_time"] == pytest.approx(times[force.argmax()] / 36_000, abs=1e-8)
    np.testing.assert_allclose(true["spin_before"], [10, 25, 0], atol=1e-12)
    # The bar stands across x, but for friction.
    assert true["restitution_normal"] == pytest.approx(32.4 / 71.55, abs=1e-3)


def test_steps_lead_from_pose_to_pose(demo_shot: demo_shot.Shot) -> None:
    np.testing.assert_allclose(demo_shot.position[1:] - demo_shot.position[:-1], demo_shot.increment[:, :2])
    assert len(demo_shot.images) == len(demo_shot.position) == len(demo_shot.orientation) == demo_motion.FRAMES


def test_the_true_motion_is_written_with_the_names_of_the_results(tmp_path: Path, demo_shot: demo_shot.Shot) -> None:
    from torchsphere.synthetic.demo_shot import true_impact, write_shot

    _, path = write_shot(tmp_path, demo_shot)
    table = np.genfromtxt(path, delimiter=",", names=True)
    assert {"frame", "x_px", "dx_px", "wz_rad", "time_s", "vx_m_s", "fx_N", "wz_rad_s"} <= set(table.dtype.names)
    assert table["vx_m_s"][0] == pytest.approx(true_impact()["velocity_before"][0])
    assert table["wz_rad_s"][-1] == pytest.approx(2 * np.pi * true_impact()["spin_after"][2])
    # The nearest frame is 0.3 frames from the middle of the contact of 12.
    assert table["fx_N"].min() == pytest.approx(-float(true_impact()["peak_force"]), rel=0.005)
    assert np.isnan(table["dx_px"][0])
