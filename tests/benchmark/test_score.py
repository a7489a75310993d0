"""Predictions and scores of the benchmark: refusals, lost frames, and errors that are known exactly."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from torchsphere.benchmark import leaderboard, prediction_table, predictions, score_rows
from torchsphere.benchmark.folder import Suite, Truth
from torchsphere.benchmark.score import CAP_DEG, CAP_PX, Score, score
from torchsphere.benchmark.score_rows import MEANS, VALUES, ScoreRow
from torchsphere.motion.ledger import INCREMENTS

N, CHECKSUM = 11, "sha256:" + "a" * 64
CIRCLE = (40.0, 30.0, 20.0)
SUITE = Suite("plain", "plain", "a ball", Path("plain"), 0, N, 112, 64, 1000.0, 30.0, None, CIRCLE, CIRCLE, CHECKSUM)
STEP, TURN = np.array([3.0, -1.0]), np.array([0.01, 0.05, -0.02])

Columns = dict[str, Sequence[float | str]]


def true_position() -> NDArray[np.float64]:
    return np.array([40.0, 30.0]) + np.arange(N)[:, None] * STEP


def true_rotation() -> Rotation:
    return Rotation.from_rotvec(np.arange(N)[:, None] * TURN)


def truth(visible: NDArray[np.float64] | None = None, shows_rotation: bool = True) -> Truth:
    # The truth may begin with any orientation; rotations count from frame 0.
    orientation = (true_rotation() * Rotation.from_rotvec([0.3, 0.1, 0.2])).as_matrix()
    return Truth(true_position(), orientation, np.ones(N) if visible is None else visible, shows_rotation)


def absolute(position: NDArray[np.float64] | None = None, rotation: Rotation | None = None) -> Columns:
    """Columns of positions and quaternions, by default the true values."""
    x, y = (true_position() if position is None else position).T.tolist()
    qx, qy, qz, qw = (true_rotation() if rotation is None else rotation).as_quat().T.tolist()
    return {"frame": range(N), "x_px": x, "y_px": y, "qw": qw, "qx": qx, "qy": qy, "qz": qz}


def increments() -> Columns:
    """Columns of the true increments."""
    named = zip(INCREMENTS, (*STEP, *TURN), strict=True)
    return {"frame": range(N), **{name: [math.nan, *[float(value)] * (N - 1)] for name, value in named}}


def scored(tmp_path: Path, columns: Columns, **of: object) -> Score:
    path = tmp_path / "plain.csv"
    prediction_table.write(path, {"suite": "plain", "checksum": CHECKSUM}, columns)
    return score(truth(**of), predictions.read(path, SUITE))  # type: ignore[arg-type]


def refused(tmp_path: Path, text: str) -> str:
    path = tmp_path / "plain.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"plain\.csv") as caught:
        predictions.read(path, SUITE)
    sentence = str(caught.value)
    assert "\n" not in sentence
    return sentence


def csv(header: str, *rows: str) -> str:
    return "\n".join((header, *rows)) + "\n"


@pytest.mark.parametrize("columns", [absolute(), increments()], ids=["absolute", "increments"])
def test_the_truth_has_no_error_as_positions_or_as_increments(tmp_path: Path, columns: Columns) -> None:
    found = scored(tmp_path, columns)
    errors = [v for kind in found.kinds for v in (kind.mean, kind.bias, kind.std)]
    # 1e-6 deg is what the arithmetic of rotations leaves.
    assert max(errors) < 1e-6
    assert (found.lost, found.lost_rotation, found.silent) == (0, 0, 0)
    assert found.points < 1e-7
    assert found.frames == N - 1


def test_a_constant_error_of_the_step_is_a_bias_without_spread_and_equals_the_drift(tmp_path: Path) -> None:
    off = np.array([0.03, 0.04])
    columns = absolute(true_position() + np.arange(N)[:, None] * off)
    found = scored(tmp_path, columns)
    step, _, place, _ = found.kinds
    assert (step.mean, step.bias, step.std) == pytest.approx((0.05, 0.05, 0), abs=1e-12)
    assert found.component_bias[:2] == pytest.approx(off)
    assert found.drift_px == pytest.approx(0.05)
    assert place.mean == pytest.approx(0.05 * 5.5)


def test_alternating_errors_are_spread_without_bias_or_drift(tmp_path: Path) -> None:
    sign = np.array([0, *[1, -1, -1, 1] * 2, 1, -1])
    place = true_position() + sign[:, None] * np.array([0.3, 0.4])
    _, _, errors, _ = scored(tmp_path, absolute(place)).kinds
    assert (errors.mean, errors.bias, errors.std) == pytest.approx((0.5, 0, 0.5), abs=1e-12)


def test_a_rotation_error_is_the_angle_between_the_orientations(tmp_path: Path) -> None:
    off = Rotation.from_rotvec(np.arange(N)[:, None] * np.radians([0, 0, 0.1]))
    _, step, _, orientation = scored(tmp_path, absolute(rotation=off * true_rotation())).kinds
    assert orientation.mean == pytest.approx(0.1 * 5.5, abs=1e-6)
    # The rotation of the ball between both ends, 0.055 rad, changes the error of at most 1 deg a little.
    assert step.mean == pytest.approx(0.1, abs=0.03)


def test_orientations_count_from_the_first_frame_for_any_stated_first_orientation(tmp_path: Path) -> None:
    elsewhere = Rotation.from_rotvec([1.0, 0.5, -2.0])
    turned = scored(tmp_path, absolute(rotation=true_rotation() * elsewhere))
    assert turned.kinds[3].mean < 1e-6


def test_a_lost_frame_counts_as_the_cap_in_every_mean_bias_and_spread(tmp_path: Path) -> None:
    columns = absolute()
    for name in ("x_px", "y_px", "qw", "qx", "qy", "qz"):
        columns[name] = [math.nan if frame == 5 else value for frame, value in enumerate(columns[name])]
    found = scored(tmp_path, columns)
    # Of ten frames, one has no position and two have no step.
    assert [kind.mean for kind in found.kinds] == pytest.approx([0.2 * CAP_PX, 0.2 * CAP_DEG, 0.1 * CAP_PX, 1.0])
    assert found.kinds[2].bias == pytest.approx(0.1 * CAP_PX)
    assert found.kinds[2].std == pytest.approx(math.sqrt(0.1) * CAP_PX)
    assert (found.lost, found.lost_rotation, found.silent) == pytest.approx((0.1, 0.2, 0))
    assert found.points == pytest.approx(0.15)


def test_no_wrong_answer_counts_more_than_a_lost_frame(tmp_path: Path) -> None:
    wild = true_position()
    wild[5] += 300
    found = scored(tmp_path, absolute(wild))
    assert found.kinds[2].mean == pytest.approx(0.1 * CAP_PX)
    assert found.kinds[2].bias == pytest.approx(0.1 * CAP_PX)
    assert found.silent == pytest.approx(0.1)
    assert found.lost == 0


def test_a_wrong_position_is_silent_unless_the_status_doubts_the_frame(tmp_path: Path) -> None:
    wrong = true_position()
    wrong[4:7] += [1.2, 0]
    words = ["ok"] * N
    words[5] = "low_correlation"
    found = scored(tmp_path, absolute(wrong) | {"status": words})
    assert found.silent == pytest.approx(0.2)
    assert found.lost == pytest.approx(0.1)
    # The error counts in both cases.
    assert found.kinds[2].mean == pytest.approx(0.36)


def test_weak_texture_doubts_the_rotation_and_not_the_position(tmp_path: Path) -> None:
    found = scored(tmp_path, absolute() | {"status": ["weak_texture"] * N})
    assert (found.lost, found.lost_rotation) == (0, 1)


def test_a_wrong_orientation_is_silent_like_a_wrong_position(tmp_path: Path) -> None:
    off = Rotation.from_rotvec(np.radians([[0, 0, 2.5 if frame == 3 else 0] for frame in range(N)]))
    assert scored(tmp_path, absolute(rotation=off * true_rotation())).silent == pytest.approx(0.1)


def test_without_a_visible_ball_a_lost_frame_is_right_and_a_wrong_position_is_silent(tmp_path: Path) -> None:
    visible = np.ones(N)
    visible[8:] = 0.1
    columns = absolute()
    for name in ("qw", "qx", "qy", "qz"):
        columns[name] = [*columns[name][:8], *[math.nan] * 3]
    x = [*columns["x_px"][:8], math.nan, columns["x_px"][9], 12.0]
    found = scored(tmp_path, columns | {"x_px": x}, visible=visible)
    assert (found.frames, found.gone) == (7, 3)
    assert max(kind.mean for kind in found.kinds) < 1e-6
    assert (found.lost, found.lost_rotation) == (0, 0)
    assert found.gone_noticed == pytest.approx(1 / 3)
    assert found.silent == pytest.approx(0.1)


def test_without_a_pattern_rotations_are_not_scored_but_wrong_rotations_are_silent(tmp_path: Path) -> None:
    still = absolute(rotation=Rotation.identity(N))
    found = scored(tmp_path, still, shows_rotation=False)
    assert math.isnan(found.kinds[1].mean)
    assert math.isnan(found.kinds[3].mean)
    assert found.points < 1e-9
    # 0.055 rad per frame is more than the limit from frame 1 on.
    assert found.silent == 1
    honest = scored(tmp_path, {name: still[name] for name in ("frame", "x_px", "y_px")}, shows_rotation=False)
    assert honest.silent == 0


def test_a_tracker_without_rotation_has_the_cap_as_its_rotation_errors(tmp_path: Path) -> None:
    columns = {name: absolute()[name] for name in ("frame", "x_px", "y_px")}
    found = scored(tmp_path, columns)
    assert not found.measures_rotation
    assert [kind.mean for kind in found.kinds] == pytest.approx([0, CAP_DEG, 0, CAP_DEG])
    assert math.isnan(found.lost_rotation)
    assert (found.silent, found.points) == pytest.approx((0, 0.5))


def test_a_single_rotation_component_has_statistics_but_counts_as_no_rotation(tmp_path: Path) -> None:
    columns = increments()
    columns = {name: columns[name] for name in ("frame", "dx_px", "dy_px", "wz_rad")}
    columns["wz_rad"] = [value + 0.001 for value in columns["wz_rad"]]
    found = scored(tmp_path, columns)
    assert not found.measures_rotation
    assert found.component_bias[4] == pytest.approx(math.degrees(0.001))
    assert np.isnan(found.component_bias[2:4]).all()
    assert found.kinds[1].mean == CAP_DEG


def test_stated_uncertainties_are_compared_with_the_errors(tmp_path: Path) -> None:
    columns = increments() | {f"sd_{name}": [0.1] * N for name in ("dx_px", "dy_px")}
    columns["dx_px"] = [math.nan, *[3.0 + error for error in (0.1, -0.1, 0.1, -0.1, 0.1, -0.1, 0.1, -0.1, 0.3, -0.3)]]
    found = scored(tmp_path, columns)
    # Of twenty components, eight have an error of one sd, two of three sd, and ten have none.
    assert found.calibration_px.ratio == pytest.approx(math.sqrt((8 + 2 * 9) / 20))
    assert found.calibration_px.within == pytest.approx(0.9)
    assert math.isnan(found.calibration_deg.ratio)


def test_increments_after_a_gap_leave_the_orientation_unknown(tmp_path: Path) -> None:
    columns = increments() | {name: absolute()[name] for name in ("x_px", "y_px")}
    columns["wy_rad"] = [math.nan if frame == 4 else value for frame, value in enumerate(columns["wy_rad"])]
    _, step, place, orientation = scored(tmp_path, columns).kinds
    assert place.mean < 1e-9
    assert step.mean == pytest.approx(0.1 * CAP_DEG)
    assert orientation.mean == pytest.approx(0.7 * CAP_DEG)


def test_missing_frames_are_lost_and_a_note_says_how_many(tmp_path: Path) -> None:
    path = tmp_path / "plain.csv"
    prediction_table.write(path, {}, {name: values[: N - 4] for name, values in absolute().items()})
    prediction = predictions.read(path, SUITE)
    assert prediction.notes[0] == "plain.csv: 4 of 11 frames are not in the file and count as lost."
    assert score(truth(), prediction).lost == pytest.approx(0.4)


@pytest.mark.parametrize("blank", ["", "nan", "NaN", "NA"])
def test_an_empty_value_and_nan_are_a_lost_frame(tmp_path: Path, blank: str) -> None:
    path = tmp_path / "plain.csv"
    path.write_text(csv("frame,x_px,y_px", "0,40,30", f"1,{blank},29", "2,46,28"))
    prediction = predictions.read(path, SUITE)
    assert np.isnan(prediction.position[1]).all()
    assert prediction.position[2].tolist() == [46, 28]


def test_rows_may_come_in_any_order_and_a_track_csv_is_accepted(tmp_path: Path) -> None:
    path = tmp_path / "plain.csv"
    path.write_text(csv("frame,time_s,status,x_px,y_px,zncc,iterations", "1,,ok,43,29,0.99,3", "0,,ok,40,30,,0"))
    assert predictions.read(path, SUITE).position[1].tolist() == [43, 29]


def test_a_suite_without_a_file_is_lost_in_every_frame() -> None:
    found = score(truth(), predictions.lost(SUITE, "There is no plain.csv."))
    assert (found.points, found.lost, found.lost_rotation, found.silent) == (1, 1, 1, 0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "is empty"),
        (csv("x_px,y_px", "40,30"), "no column 'frame'"),
        (csv("frame,x,y", "0,40,30"), "unknown column 'x'"),
        (csv("frame,x_px", "0,40"), "neither x_px and y_px nor dx_px and dy_px"),
        (csv("frame,x_px,y_px,qw", "0,40,30,1"), "some of qw, qx, qy, qz only"),
        (csv("frame,x_px,x_px,y_px", "0,40,40,30"), "a column twice"),
        (csv("frame,x_px,y_px", "0,40"), "line 2: 2 values for 3 columns"),
        (csv("frame,x_px,y_px", "0,40,thirty"), "line 2: y_px = 'thirty' is no number"),
        (csv("frame,x_px,y_px", "0,40,inf"), "infinite"),
        (csv("frame,x_px,y_px", "0.5,40,30"), "frame '0.5' is no frame number"),
        (csv("frame,x_px,y_px", "0,40,30", "0,41,30"), "has frame 0 more than once"),
        (csv("frame,x_px,y_px", "0,40,30", "11,41,30"), "a frame 11, but suite 'plain' ends with 10"),
        (csv("frame,suite,x_px,y_px", "0,fast-spin,40,30"), "of suite 'fast-spin', not 'plain'"),
        (csv("# suite: fast-spin", "frame,x_px,y_px", "0,40,30"), "of suite 'fast-spin', not 'plain'"),
        (csv("# checksum: sha256:bbb", "frame,x_px,y_px", "0,40,30"), "from other images of suite 'plain'"),
        (csv("frame,x_px,y_px", "0,80,60"), "another suite's file"),
        (csv("frame,x_px,y_px,qw,qx,qy,qz", "0,40,30,2,0,0,0"), "the length 2 in frame 0"),
        (csv("frame,x_px,y_px,qw,qx,qy,qz", "0,40,30,,,,", "1,43,29,1,0,0,0"), "frame 0 has no qw"),
        (csv("frame,x_px,y_px,wx_rad,wy_rad,wz_rad", "0,40,30,,,", "1,43,29,0,5,0"), "expected rad, not degrees"),
        (csv("frame,x_px,y_px,sd_dx_px", "0,40,30,", "1,43,29,0"), "sd_dx_px is 0 or less in frame 1"),
    ],
)
def test_an_invalid_prediction_is_refused_in_one_sentence(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in refused(tmp_path, text)


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plain.csv"
    path.write_bytes(b"II*\x00\xff\xfe")
    with pytest.raises(ValueError, match="is no text"):
        predictions.read(path, SUITE)


def rows(
    tracker: str, points: dict[str, float], checksum: str = CHECKSUM, rotation: str = "measured"
) -> list[ScoreRow]:
    """Scores whose four errors are all ``points``."""
    made = []
    for suite, value in points.items():
        numbers = dict.fromkeys(VALUES, math.nan) | dict.fromkeys(MEANS, value)
        numbers |= {"points_percent": value, "lost_percent": 0.0, "silent_percent": 0.0}
        made.append(ScoreRow(tracker, suite, checksum, rotation, numbers, ""))
    return made


def test_scores_are_read_as_they_were_written(tmp_path: Path) -> None:
    written = rows("torchsphere", {"plain": 0.125, "low-light": 0.5})
    score_rows.write(tmp_path / "scores.csv", written)
    read = score_rows.read(tmp_path / "scores.csv")
    assert [dataclasses.replace(row, values={}) for row in read] == [
        dataclasses.replace(row, values={}) for row in written
    ]
    for row, other in zip(read, written, strict=True):
        assert list(row.values.values()) == pytest.approx(list(other.values.values()), nan_ok=True)


def test_the_name_of_a_tracker_is_no_formula_of_a_spreadsheet(tmp_path: Path) -> None:
    score_rows.write(tmp_path / "scores.csv", rows("=HYPERLINK(1)", {"plain": 0.5}))
    assert "\n'=HYPERLINK(1),plain" in (tmp_path / "scores.csv").read_text()
    assert score_rows.read(tmp_path / "scores.csv")[0].tracker == "=HYPERLINK(1)"


def test_cells_longer_than_any_table_has_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "plain.csv"
    path.write_text("tracker,frame,x_px\n" + "x" * 140_000 + ",0,1\n")
    for reader in (score_rows.read, prediction_table.read):
        with pytest.raises(ValueError, match=r"plain\.csv: is no .* in UTF-8 \(field larger than"):
            reader(path)


def test_a_file_without_scores_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("frame,x_px\n0,1\n")
    with pytest.raises(ValueError, match=r"a\.csv: has no column 'tracker'"):
        score_rows.read(tmp_path / "a.csv")


def test_the_board_is_sorted_and_a_missing_suite_counts_100_percent() -> None:
    made = leaderboard.board(rows("half", {"plain": 0.0}) + rows("whole", {"plain": 20.0, "low-light": 30.0}))
    assert made.trackers == ("whole", "half")
    assert [made.points(tracker) for tracker in made.trackers] == [25, 50]
    text = leaderboard.markdown(made)
    assert "| low-light | 30 | not run |" in text


def test_the_leaderboard_lists_lost_contests_and_counts_no_variant_as_a_rival() -> None:
    made = rows("torchsphere", {"plain": 0.02, "low-light": 0.03}) + rows("torchsphere-map", {"plain": 0.01})
    text = leaderboard.markdown(leaderboard.board(made + rows("ecc", {"plain": 0.5, "low-light": 0.02})))
    assert "ahead of every rival in 4 of 8 errors, and not in:" in text
    assert "- low-light, position (px): ecc 0.02, torchsphere 0.03" in text
    assert "- plain" not in text


def test_rotations_that_are_not_measured_are_named_so() -> None:
    text = leaderboard.markdown(leaderboard.board(rows("hough", {"plain": 3.0}, rotation="not measured")))
    assert "| hough | 3 | 3 | not measured | 3 | not measured |" in text


def test_scores_on_different_images_or_twice_the_same_are_refused() -> None:
    with pytest.raises(ValueError, match="'a' and 'b' were scored on different images"):
        leaderboard.board(rows("a", {"plain": 1.0}) + rows("b", {"plain": 1.0}, checksum="sha256:other"))
    with pytest.raises(ValueError, match="'a' is there twice"):
        leaderboard.board(rows("a", {"plain": 1.0}) * 2)
