"""Standard deviations of the turned angles."""

import dataclasses

import numpy as np
import pytest

from torchsphere.motion.ledger import INCREMENTS
from torchsphere.report.time_series import sd_turned_rad, time_series
from torchsphere.results.reader import ResultFolder


def with_errors(result: ResultFolder, share: float, steady: float, relative: float) -> ResultFolder:
    own = {
        "drift_share": share,
        "sd_steady": dict.fromkeys(INCREMENTS, steady),
        "radius_effect": {"relative_sd_rotation": relative},
    }
    sd = np.full_like(result.sd_increment, 2e-4)
    return dataclasses.replace(result, summary=result.summary | own, sd_increment=sd)


def test_on_a_map_only_the_errors_of_the_first_and_the_last_pose_remain(result: ResultFolder) -> None:
    sd = sd_turned_rad(with_errors(result, 0.0, 0.0, 0.0))
    assert sd is not None
    assert (sd[0] == 0).all()
    np.testing.assert_allclose(sd[1:], 2e-4, rtol=1e-12)


def test_steady_errors_grow_with_the_frames_and_those_of_the_radius_with_the_angle(result: ResultFolder) -> None:
    sd = sd_turned_rad(with_errors(result, 0.0, 1e-3, 0.0))
    assert sd is not None
    np.testing.assert_allclose(sd[-1], np.hypot(2e-4, 1e-3 * (len(sd) - 1)), rtol=1e-12)
    by_radius = sd_turned_rad(with_errors(result, 0.0, 0.0, 0.01))
    assert by_radius is not None
    np.testing.assert_allclose(by_radius[-1], np.hypot(2e-4, 0.01 * result.turned_rad[-1]), rtol=1e-12)


def test_without_a_map_a_share_of_each_error_stays(result: ResultFolder) -> None:
    sd = sd_turned_rad(with_errors(result, 0.08, 0.0, 0.0))
    assert sd is not None
    steps = len(sd) - 1
    np.testing.assert_allclose(sd[-1], 2e-4 * np.sqrt(1 + 0.08 * steps), rtol=1e-12)


def test_the_angles_of_the_demo_agree_with_the_truth_within_their_deviations(result: ResultFolder, demo_shot) -> None:
    # The result begins at frame 20 of the shot; a sum of rotation vectors, as in the truth.
    true = np.concatenate((np.zeros((1, 3)), demo_shot.increment[20:45, 2:].cumsum(0)))
    sd = sd_turned_rad(result)
    assert sd is not None
    assert (np.abs(result.turned_rad - true)[1:] < 4 * sd[1:]).all()
    # Turns about the optical axis do not depend on the camera's distance, which is not known here.
    assert np.degrees(np.nanmax(sd[:, 2])) < 0.1


def test_results_of_earlier_versions_have_angles_without_deviations(result: ResultFolder) -> None:
    older = {key: value for key, value in result.summary.items() if key != "sd_steady"}
    assert sd_turned_rad(dataclasses.replace(result, summary=older)) is None
    series = {quantity.key: quantity for quantity in time_series(dataclasses.replace(result, summary=older))}
    assert series["turned"].sd is None
    assert {quantity.key: quantity for quantity in time_series(result)}["turned"].has_sd


def test_the_orientation_of_the_first_frame_alone_is_no_measurement(tmp_path, measured) -> None:
    import shutil

    from torchsphere.results.reader import read

    folder = shutil.copytree(measured[0], tmp_path / "copy")
    head, first, *rest = (folder / "track.csv").read_text().splitlines()
    cut = [",".join([*line.split(",")[:-4], "nan", "nan", "nan", "nan"]) for line in rest]
    (folder / "track.csv").write_text("\n".join([head, first, *cut]) + "\n")
    assert np.isnan(read(folder).quaternion).all()
    assert pytest.approx(1) == read(measured[0]).quaternion[0, 0]
