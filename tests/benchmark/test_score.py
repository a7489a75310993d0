"""Predictions and scores of the benchmark: what is refused, what counts as lost, and errors that are known exactly."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from torchsphere.benchmark import prediction_table, predictions, table
from torchsphere.benchmark.errors import Truth
from torchsphere.benchmark.prediction_checks import Given
from torchsphere.benchmark.score import CAP_DEG, CAP_PX, Score, score
from torchsphere.benchmark.standing import VALUES, Standing
from torchsphere.benchmark.standing import read as read_scores
from torchsphere.benchmark.standing import write as write_scores

N, CHECKSUM = 11, "sha256:" + "a" * 64
GIVEN = Given("plain", N, (40.0, 30.0, 20.0), CHECKSUM)
STEP, TURN = np.array([3.0, -1.0]), np.array([0.01, 0.05, -0.02])

Columns = dict[str, Sequence[float | str]]


def true_position() -> NDArray[np.float64]:
    return np.array([40.0, 30.0]) + np.arange(N)[:, None] * STEP


def true_rotation() -> Rotation:
    return Rotation.from_rotvec(np.arange(N)[:, None] * TURN)


def truth(visible: NDArray[np.float64] | None = None, shows_rotation: bool = True) -> Truth:
    # The truth need not begin with no rotation at all; only what comes after frame 0 counts.
    orientation = (true_rotation() * Rotation.from_rotvec([0.3, 0.1, 0.2])).as_matrix()
    return Truth(true_position(), orientation, np.ones(N) if visible is None else visible, shows_rotation)


def absolute(position: NDArray[np.float64] | None = None, rotation: Rotation | None = None) -> Columns:
    """Columns of places and quaternions, by default the true ones."""
    x, y = (true_position() if position is None else position).T.tolist()
    qx, qy, qz, qw = (true_rotation() if rotation is None else rotation).as_quat().T.tolist()
    return {"frame": range(N), "x_px": x, "y_px": y, "qw": qw, "qx": qx, "qy": qy, "qz": qz}


def increments() -> Columns:
    """Columns of the true increments."""
    named = zip(prediction_table.STEP, (*STEP, *TURN), strict=True)
    return {"frame": range(N), **{name: [math.nan, *[float(value)] * (N - 1)] for name, value in named}}


def scored(tmp_path: Path, columns: Columns, **of: object) -> Score:
    path = tmp_path / "plain.csv"
    prediction_table.write(path, {"suite": "plain", "checksum": CHECKSUM}, columns)
    return score(truth(**of), predictions.read(path, GIVEN))  # type: ignore[arg-type]


def refused(tmp_path: Path, text: str) -> str:
    path = tmp_path / "plain.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"plain\.csv") as caught:
        predictions.read(path, GIVEN)
    sentence = str(caught.value)
    assert "\n" not in sentence
    return sentence


def csv(header: str, *rows: str) -> str:
    return "\n".join((header, *rows)) + "\n"


@pytest.mark.parametrize("columns", [absolute(), increments()], ids=["absolute", "increments"])
def test_the_truth_itself_scores_no_error_as_places_or_as_increments(tmp_path: Path, columns: Columns) -> None:
    found = scored(tmp_path, columns)
    errors = [v for kind in found.kinds for v in (kind.mean, kind.bias, kind.std)]
    # 1e-6 deg is what the arithmetic of rotations leaves.
    assert max(errors) < 1e-6
    assert (found.lost, found.lost_rotation, found.silent) == (0, 0, 0)
    assert found.points < 1e-7
    assert found.frames == N - 1


def test_a_constant_error_of_the_step_is_bias_without_spread_and_drifts_by_itself_each_frame(tmp_path: Path) -> None:
    off = np.array([0.03, 0.04])
    columns = absolute(true_position() + np.arange(N)[:, None] * off)
    found = scored(tmp_path, columns)
    step, _, place, _ = found.kinds
    assert (step.mean, step.bias, step.std) == pytest.approx((0.05, 0.05, 0), abs=1e-12)
    assert found.component_bias[:2] == pytest.approx(off)
    assert found.drift_px == pytest.approx(0.05)
    assert place.mean == pytest.approx(0.05 * 5.5)


def test_errors_to_and_fro_are_spread_without_bias_and_do_not_drift(tmp_path: Path) -> None:
    sign = np.array([0, *[1, -1, -1, 1] * 2, 1, -1])
    place = true_position() + sign[:, None] * np.array([0.3, 0.4])
    _, _, errors, _ = scored(tmp_path, absolute(place)).kinds
    assert (errors.mean, errors.bias, errors.std) == pytest.approx((0.5, 0, 0.5), abs=1e-12)


def test_a_rotation_error_is_the_angle_between_the_orientations(tmp_path: Path) -> None:
    off = Rotation.from_rotvec(np.arange(N)[:, None] * np.radians([0, 0, 0.1]))
    _, step, _, orientation = scored(tmp_path, absolute(rotation=off * true_rotation())).kinds
    assert orientation.mean == pytest.approx(0.1 * 5.5, abs=1e-6)
    # The error at each end is turned a little by the ball's own turn: 0.055 rad of at most 1 deg.
    assert step.mean == pytest.approx(0.1, abs=0.03)


def test_orientations_count_from_the_first_frame_whatever_it_is_called_there(tmp_path: Path) -> None:
    elsewhere = Rotation.from_rotvec([1.0, 0.5, -2.0])
    turned = scored(tmp_path, absolute(rotation=true_rotation() * elsewhere))
    assert turned.kinds[3].mean < 1e-6


def test_a_lost_frame_counts_as_the_cap_in_every_mean_bias_and_spread(tmp_path: Path) -> None:
    columns = absolute()
    for name in ("x_px", "y_px", "qw", "qx", "qy", "qz"):
        columns[name] = [math.nan if frame == 5 else value for frame, value in enumerate(columns[name])]
    found = scored(tmp_path, columns)
    # Of ten frames one has no place, and two have no step.
    assert [kind.mean for kind in found.kinds] == pytest.approx([0.2 * CAP_PX, 0.2 * CAP_DEG, 0.1 * CAP_PX, 1.0])
    assert found.kinds[2].bias == pytest.approx(0.1 * CAP_PX)
    assert found.kinds[2].std == pytest.approx(math.sqrt(0.1) * CAP_PX)
    assert (found.lost, found.lost_rotation, found.silent) == pytest.approx((0.1, 0.2, 0))
    assert found.points == pytest.approx(0.15)


def test_no_answer_is_worth_less_than_a_lost_frame(tmp_path: Path) -> None:
    wild = true_position()
    wild[5] += 300
    found = scored(tmp_path, absolute(wild))
    assert found.kinds[2].mean == pytest.approx(0.1 * CAP_PX)
    assert found.kinds[2].bias == pytest.approx(0.1 * CAP_PX)
    assert found.silent == pytest.approx(0.1)
    assert found.lost == 0


def test_a_wrong_place_is_silent_unless_the_status_says_that_it_is_not_to_be_relied_on(tmp_path: Path) -> None:
    wrong = true_position()
    wrong[4:7] += [1.2, 0]
    words = ["ok"] * N
    words[5] = "low_correlation"
    found = scored(tmp_path, absolute(wrong) | {"status": words})
    assert found.silent == pytest.approx(0.2)
    assert found.lost == pytest.approx(0.1)
    # The number counts all the same.
    assert found.kinds[2].mean == pytest.approx(0.36)


def test_weak_texture_doubts_the_rotation_and_not_the_place(tmp_path: Path) -> None:
    found = scored(tmp_path, absolute() | {"status": ["weak_texture"] * N})
    assert (found.lost, found.lost_rotation) == (0, 1)


def test_an_orientation_that_is_wrong_is_silent_as_a_place_is(tmp_path: Path) -> None:
    off = Rotation.from_rotvec(np.radians([[0, 0, 2.5 if frame == 3 else 0] for frame in range(N)]))
    assert scored(tmp_path, absolute(rotation=off * true_rotation())).silent == pytest.approx(0.1)


def test_where_the_ball_is_gone_lost_is_right_and_a_stated_place_silent_only_where_wrong(tmp_path: Path) -> None:
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


def test_a_ball_without_a_pattern_has_no_rotation_to_be_scored_but_one_to_be_wrong_about(tmp_path: Path) -> None:
    still = absolute(rotation=Rotation.identity(N))
    found = scored(tmp_path, still, shows_rotation=False)
    assert math.isnan(found.kinds[1].mean)
    assert math.isnan(found.kinds[3].mean)
    assert found.points < 1e-9
    # 0.055 rad a frame are wrong from the first frame on.
    assert found.silent == 1
    honest = scored(tmp_path, {name: still[name] for name in ("frame", "x_px", "y_px")}, shows_rotation=False)
    assert honest.silent == 0


def test_a_tracker_without_rotation_pays_the_cap_for_it_and_says_so(tmp_path: Path) -> None:
    columns = {name: absolute()[name] for name in ("frame", "x_px", "y_px")}
    found = scored(tmp_path, columns)
    assert not found.measures_rotation
    assert [kind.mean for kind in found.kinds] == pytest.approx([0, CAP_DEG, 0, CAP_DEG])
    assert math.isnan(found.lost_rotation)
    assert (found.silent, found.points) == pytest.approx((0, 0.5))


def test_one_component_of_a_rotation_is_told_but_is_no_rotation(tmp_path: Path) -> None:
    columns = increments()
    columns = {name: columns[name] for name in ("frame", "dx_px", "dy_px", "wz_rad")}
    columns["wz_rad"] = [value + 0.001 for value in columns["wz_rad"]]
    found = scored(tmp_path, columns)
    assert not found.measures_rotation
    assert found.component_bias[4] == pytest.approx(math.degrees(0.001))
    assert np.isnan(found.component_bias[2:4]).all()
    assert found.kinds[1].mean == CAP_DEG


def test_stated_uncertainties_are_held_against_the_errors(tmp_path: Path) -> None:
    columns = increments() | {f"sd_{name}": [0.1] * N for name in ("dx_px", "dy_px")}
    columns["dx_px"] = [math.nan, *[3.0 + error for error in (0.1, -0.1, 0.1, -0.1, 0.1, -0.1, 0.1, -0.1, 0.3, -0.3)]]
    found = scored(tmp_path, columns)
    # Twenty components: eight of one sd, two of three, ten of none.
    assert found.honesty_px.ratio == pytest.approx(math.sqrt((8 + 2 * 9) / 20))
    assert found.honesty_px.within == pytest.approx(0.9)
    assert math.isnan(found.honesty_deg.ratio)


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
    prediction = predictions.read(path, GIVEN)
    assert prediction.notes[0] == "plain.csv: 4 of 11 frames are not in the file and count as lost."
    assert score(truth(), prediction).lost == pytest.approx(0.4)


@pytest.mark.parametrize("blank", ["", "nan", "NaN", "NA"])
def test_an_empty_value_and_nan_are_a_frame_lost(tmp_path: Path, blank: str) -> None:
    path = tmp_path / "plain.csv"
    path.write_text(csv("frame,x_px,y_px", "0,40,30", f"1,{blank},29", "2,46,28"))
    prediction = predictions.read(path, GIVEN)
    assert np.isnan(prediction.position[1]).all()
    assert prediction.position[2].tolist() == [46, 28]


def test_rows_may_come_in_any_order_and_a_result_of_torchsphere_track_is_taken_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "plain.csv"
    path.write_text(csv("frame,time_s,status,x_px,y_px,zncc,iterations", "1,,ok,43,29,0.99,3", "0,,ok,40,30,,0"))
    assert predictions.read(path, GIVEN).position[1].tolist() == [43, 29]


def test_a_suite_without_any_file_is_lost_in_every_frame() -> None:
    found = score(truth(), predictions.nothing(GIVEN, "There is no plain.csv."))
    assert (found.points, found.lost, found.lost_rotation, found.silent) == (1, 1, 1, 0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "is empty"),
        (csv("x_px,y_px", "40,30"), "no column 'frame'"),
        (csv("frame,x,y", "0,40,30"), "unknown column 'x'"),
        (csv("frame,x_px", "0,40"), "neither x_px and y_px nor dx_px and dy_px"),
        (csv("frame,x_px,y_px,qw", "0,40,30,1"), "some of qw, qx, qy, qz only"),
        (csv("frame,x_px,x_px,y_px", "0,40,40,30"), "twice"),
        (csv("frame,x_px,y_px", "0,40"), "line 2: 2 values for 3 columns"),
        (csv("frame,x_px,y_px", "0,40,thirty"), "line 2: y_px = 'thirty' is no number"),
        (csv("frame,x_px,y_px", "0,40,inf"), "infinite"),
        (csv("frame,x_px,y_px", "0.5,40,30"), "frame '0.5' is no number of a frame"),
        (csv("frame,x_px,y_px", "0,40,30", "0,41,30"), "frame 0 is there more than once"),
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
def test_what_cannot_be_a_prediction_for_the_suite_is_refused_in_one_sentence(
    tmp_path: Path, text: str, expected: str
) -> None:
    assert expected in refused(tmp_path, text)


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plain.csv"
    path.write_bytes(b"II*\x00\xff\xfe")
    with pytest.raises(ValueError, match="is no text"):
        predictions.read(path, GIVEN)


def rows(
    tracker: str, points: dict[str, float], checksum: str = CHECKSUM, rotation: str = "measured"
) -> list[Standing]:
    """Scores whose four errors are all ``points``."""
    made = []
    for suite, value in points.items():
        numbers = dict.fromkeys(VALUES, math.nan) | dict.fromkeys(table.MEANS, value)
        numbers |= {"points_percent": value, "lost_percent": 0.0, "silent_percent": 0.0}
        made.append(Standing(tracker, suite, checksum, rotation, numbers, ""))
    return made


def test_scores_come_back_from_their_file(tmp_path: Path) -> None:
    written = rows("torchsphere", {"plain": 0.125, "low-light": 0.5})
    write_scores(tmp_path / "scores.csv", written)
    read = read_scores(tmp_path / "scores.csv")
    assert [dataclasses.replace(row, values={}) for row in read] == [
        dataclasses.replace(row, values={}) for row in written
    ]
    for row, other in zip(read, written, strict=True):
        assert list(row.values.values()) == pytest.approx(list(other.values.values()), nan_ok=True)


def test_a_file_that_holds_no_scores_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("frame,x_px\n0,1\n")
    with pytest.raises(ValueError, match=r"a\.csv: has no column 'tracker'"):
        read_scores(tmp_path / "a.csv")


def test_the_board_is_sorted_and_a_suite_that_was_not_run_counts_as_nothing_measured() -> None:
    made = table.board(rows("half", {"plain": 0.0}) + rows("whole", {"plain": 20.0, "low-light": 30.0}))
    assert made.trackers == ("whole", "half")
    assert [made.points(tracker) for tracker in made.trackers] == [25, 50]
    text = table.markdown(made)
    assert "| low-light | 30 | not run |" in text


def test_the_table_says_where_torchsphere_does_not_lead_and_counts_no_variant_as_a_rival() -> None:
    made = rows("torchsphere", {"plain": 0.02, "low-light": 0.03}) + rows("torchsphere-map", {"plain": 0.01})
    text = table.markdown(table.board(made + rows("ecc", {"plain": 0.5, "low-light": 0.02})))
    assert "ahead of every rival in 4 of 8 errors, and not in:" in text
    assert "- low-light, position (px): ecc 0.02, torchsphere 0.03" in text
    assert "- plain" not in text


def test_what_is_not_measured_is_said_in_words() -> None:
    text = table.markdown(table.board(rows("hough", {"plain": 3.0}, rotation="not measured")))
    assert "| hough | 3 | 3 | not measured | 3 | not measured |" in text


def test_scores_on_different_images_are_not_joined() -> None:
    with pytest.raises(ValueError, match="'a' and 'b' were scored on different images"):
        table.board(rows("a", {"plain": 1.0}) + rows("b", {"plain": 1.0}, checksum="sha256:other"))
    with pytest.raises(ValueError, match="'a' is there twice"):
        table.board(rows("a", {"plain": 1.0}) * 2)
