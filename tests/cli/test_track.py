"""The command ``torchsphere track``: written results."""

import csv
import html
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import tifffile
import torch

from torchsphere.cli.main import main
from torchsphere.results.reader import TRACK_COLUMNS, read
from torchsphere.synthetic import demo_shot as demo
from torchsphere.synthetic import ray_caster

#: Neither a page nor a map of the ball, where the test is about neither.
FAST = ("--quiet", "--no-report", "--map", "off")

CIRCLE = "64.3,92.6,40"


def rows(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    with path.open(newline="") as stream:
        reader = csv.DictReader(stream)
        return list(reader.fieldnames or ()), list(reader)


def test_track_writes_the_promised_columns_with_the_first_row_empty(tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--fps", "36000", "--diameter-mm", "30", "--mass-g", "110"]
    assert main([*arguments, *FAST]) == 0
    head, table = rows(out / "track.csv")
    assert head == list(TRACK_COLUMNS)
    assert [row["status"] for row in table] == ["ok"] * 8
    assert table[0]["dx_px"] == "nan"
    assert float(table[0]["qw"]) == 1.0
    assert all(float(row["dx_px"]) == pytest.approx(5.3, abs=0.05) for row in table[1:])
    head, _ = rows(out / "kinematics.csv")
    assert head[:3] == ["time_s", "x_m", "y_m"]
    assert "sd_fx_N" in head
    assert head[-1] == "frame"
    parquet = pq.read_table(out / "track.parquet")
    assert parquet.num_rows == 8
    covariance = np.array(parquet["covariance"].to_pylist()[3]).reshape(5, 5)
    np.testing.assert_allclose(np.sqrt(covariance[0, 0]), float(table[3]["sd_dx_px"]), rtol=1e-8)


def test_the_summary_holds_input_settings_and_versions(tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    assert main(["track", str(short), "--out", str(out), "--circle", CIRCLE, "--frames", "2:6", *FAST]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["input"]["path"] == str(short)
    assert len(summary["input"]["sha256"]) == 64
    assert (summary["input"]["first_frame"], summary["input"]["last_frame"]) == (2, 5)
    assert summary["settings"]["model"] == "rigid"
    assert summary["frames_per_status"] == {"ok": 4}
    assert "torch" in summary["versions"]
    assert any("frame rate is not known" in sentence for sentence in summary["warnings"])
    assert not (out / "kinematics.csv").exists()
    _, table = rows(out / "track.csv")
    assert [row["frame"] for row in table] == ["2", "3", "4", "5"]
    assert [row["time_s"] for row in table] == [""] * 4


def test_options_come_from_a_file_and_the_command_line_wins(tmp_path: Path, short: Path) -> None:
    config = tmp_path / "shot.toml"
    config.write_text('fps = 1000\nmm-per-px = 0.5\nmodel = "finite"\ncircle = [64.3, 92.6, 40]\nframes = "0:4"\n')
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--config", str(config), "--diameter-mm", "30", *FAST]
    assert main(arguments) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["settings"]["model"] == "finite"
    assert summary["frame_rate"] == 1000
    assert summary["scale"]["m_per_px"] == pytest.approx(0.03 / 80)
    assert summary["input"]["last_frame"] == 3


def test_a_file_of_options_may_have_a_byte_order_mark_and_no_setting_twice(tmp_path: Path, short: Path, capsys) -> None:
    config = tmp_path / "shot.toml"
    config.write_text('fps = 1000\nframes = "0:4"\n', encoding="utf-8-sig")
    arguments = ["track", str(short), "--circle", CIRCLE, "--config", str(config), *FAST]
    assert main([*arguments, "--out", str(tmp_path / "result")]) == 0
    assert json.loads((tmp_path / "result" / "summary.json").read_text())["frame_rate"] == 1000
    config.write_text("mm-per-px = 1\nmm_per_px = 2\n")
    assert main([*arguments, "--out", str(tmp_path / "other")]) == 2
    assert "mm_per_px is given twice" in capsys.readouterr().err


def test_a_region_outside_the_image_is_warned_of(tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    arguments = [
        "track",
        str(short),
        "--out",
        str(out),
        "--circle",
        CIRCLE,
        "--frames",
        "0:3",
        "--no-report",
        "--quiet",
    ]
    assert main([*arguments, "--ignore", "900,900 910,900 910,910"]) == 0
    warnings = json.loads((out / "summary.json").read_text())["warnings"]
    assert any("--ignore '900,900 910,900 910,910' covers no pixel" in sentence for sentence in warnings)


def test_the_focal_length_follows_from_the_distance_and_other_camera_settings_from_a_file(
    tmp_path: Path, short: Path
) -> None:
    config = tmp_path / "shot.toml"
    config.write_text('model = "pinhole"\nprincipal-px = [70, 80]\ndistortion = [-0.1, 0.01, 0]\n')
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--config", str(config), "--frames", "1:4"]
    assert main([*arguments, "--distance-mm", "1500", "--diameter-mm", "30", "--fps", "1000", *FAST]) == 0
    summary = json.loads((out / "summary.json").read_text())
    camera = summary["settings"]["camera"]
    # 1.5 m are 100 radii of 15 mm: the focal length is 100 times the outline of 40 px, to a part in 20 000.
    assert camera["focal_px"] == pytest.approx(4000.0, rel=1e-4)
    assert (camera["principal_px"], camera["distortion"]) == ([70, 80], [-0.1, 0.01, 0])
    _, table = rows(out / "kinematics.csv")
    assert [(row["frame"], row["time_s"]) for row in table] == [("1", "0.001"), ("2", "0.002"), ("3", "0.003")]
    # 5.3 px per frame of 1 ms at 15 mm / 40 px; at this distance perspective and distortion are negligible.
    assert all(float(row["vx_m_s"]) == pytest.approx(5.3 * 0.015 / 40 * 1000, rel=0.02) for row in table[1:-1])


def test_without_a_mass_there_is_no_force_and_the_summary_states_a_missing_impact(tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--fps", "36000", "--diameter-mm", "30"]
    assert main([*arguments, "--quiet"]) == 0
    head, _ = rows(out / "kinematics.csv")
    assert not [name for name in head if name.endswith("_N")]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["impact"] is None
    assert any(sentence.startswith("No impact is reported: ") for sentence in summary["warnings"])
    assert summary["differentiation"]["method"] == "smoother"


def test_the_summary_has_the_impact_of_the_demo_with_its_uncertainty(tmp_path: Path, demo_shot: demo.Shot) -> None:
    path = tmp_path / "shot.tif"
    tifffile.imwrite(path, demo_shot.images, photometric="minisblack")
    out = tmp_path / "result"
    arguments = ["track", str(path), "--out", str(out), "--fps", "36000", "--diameter-mm", "30", "--mass-g", "110"]
    assert main([*arguments, "--method", "smoother", "--normal-deg", "180", "--scale-sd-percent", "0.1", *FAST]) == 0
    summary = json.loads((out / "summary.json").read_text())
    found = summary["impact"]
    true = demo.true_impact()
    # The normal is given here, and the truth's is that of the change of velocity.
    true["restitution_normal"] = np.asarray(32.4 / 71.55)
    for name, value in true.items():
        assert (np.abs(found[name]["value"] - value) < 3 * np.array(found[name]["sd"])).all(), name
    # 54 kN to 0.1 % by the scale that was given, and to 0.25 % by steps without a map.
    assert found["peak_force"]["sd"] < 200
    assert found["peak_force"]["unit"] == "N"


def test_errors_of_mass_rate_and_diameter_reach_the_budget_of_the_summary_and_the_report(
    tmp_path: Path, demo_shot: demo.Shot
) -> None:
    path, config, out = tmp_path / "shot.tif", tmp_path / "shot.toml", tmp_path / "result"
    tifffile.imwrite(path, demo_shot.images[20:46], photometric="minisblack")
    config.write_text("mass-sd-percent = 4\nscale_sd_percent = 3\n")
    arguments = ["track", str(path), "--out", str(out), "--fps", "36000", "--diameter-mm", "30", "--mass-g", "110"]
    arguments += ["--circle", "170.3,98.6,40", "--map", "off", "--config", str(config), "--fps-sd-percent", "2"]
    assert main([*arguments, "--quiet"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    found = summary["impact"]
    assert (found["ball"]["relative_sd_mass"], found["ball"]["relative_sd_diameter"]) == (0.04, 0.03)
    # Energy goes with mass, and with the squares of scale and rate: 4, 6 and 4 %. 400 draws give the sd to 3.5 %.
    energy, shares = found["energy_before"], found["budget"]["energy_before"]
    assert energy["sd"] / energy["value"] == pytest.approx(np.sqrt(4**2 + 6**2 + 4**2) / 100, rel=0.11)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert [shares[name] for name in ("mass", "scale", "frame_rate")] == pytest.approx(
        [16 / 68, 36 / 68, 16 / 68], abs=0.05
    )
    # Energy of a turn: mass, and the squares of diameter and rate.
    spin = found["budget"]["spin_energy_after"]
    assert spin["scale"] / spin["mass"] == pytest.approx(36 / 16, rel=0.2)
    assert summary["impacts"][0]["budget"] == found["budget"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Where the uncertainty of the impact comes from" in page
    assert page.count('<th scope="row">Largest force</th>') == 2


@pytest.mark.parametrize("method", ["savitzky-golay", "differences"])
def test_the_summary_names_the_method_of_differentiation(method: str, tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--fps", "36000", "--mm-per-px", "0.375"]
    assert main([*arguments, "--method", method, "--window", "5", "--order", "2", *FAST]) == 0
    assert json.loads((out / "summary.json").read_text())["differentiation"]["method"] == method


def test_a_window_longer_than_the_recording_is_warned_of_and_the_track_is_kept(tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--fps", "36000", "--mm-per-px", "0.375"]
    assert main([*arguments, "--method", "savitzky-golay", "--window", "9", "--no-report", "--quiet"]) == 0
    warnings = json.loads((out / "summary.json").read_text())["warnings"]
    (warning,) = (sentence for sentence in warnings if "savitzky-golay" in sentence)
    assert "there are 8 at most" in warning
    assert "give --window 7 or less" in warning


def test_an_existing_result_is_replaced_on_request_and_other_files_never(tmp_path: Path, short: Path, capsys) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--frames", "0:3", *FAST]
    assert main(arguments) == 0
    before = (out / "summary.json").stat().st_mtime_ns
    assert main(arguments) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert (out / "summary.json").stat().st_mtime_ns == before
    assert main([*arguments, "--overwrite"]) == 0
    assert (out / "summary.json").stat().st_mtime_ns > before
    other_files = tmp_path / "thesis"
    other_files.mkdir()
    (other_files / "chapter1.txt").write_text("years of work")
    assert main(["track", str(short), "--out", str(other_files), "--circle", CIRCLE, "--overwrite", *FAST]) == 1
    assert [path.name for path in other_files.iterdir()] == ["chapter1.txt"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result", "thesis"]


def test_a_missing_frame_rate_is_warned_of(tmp_path: Path, short: Path) -> None:
    arguments = ["track", str(short), "--circle", CIRCLE, "--frames", "0:2", *FAST, "--out"]
    for name, given, noted in (("without", (), True), ("with", ("--fps", "100"), False)):
        assert main([*arguments, str(tmp_path / name), *given]) == 0
        warnings = " ".join(json.loads((tmp_path / name / "summary.json").read_text())["warnings"])
        assert ("no frame rate" in warnings) == noted


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--diameter-mm", "0.03"], "The ball's diameter is 0.03 mm by --diameter-mm 0.03, which is implausible"),
        (["--diameter-mm", "0.03", "--mass-g", "110"], "0.03 mm by --diameter-mm 0.03, which is implausible"),
        (["--diameter-mm", "30", "--mass-g", "0.11"], "0.11 g by --mass-g 0.11, which makes 7.8 kg/m3"),
        (["--mm-per-px", "0.000375"], "0.03 mm by --mm-per-px 0.000375"),
        (["--diameter-mm", "30", "--mass-g", "110"], ""),
        (["--diameter-mm", "40", "--mass-g", "2.7"], ""),
        (["--diameter-mm", "30"], ""),
        (["--mm-per-px", "0.375"], ""),
    ],
)
def test_a_diameter_or_a_mass_in_another_unit_is_warned_of_once_and_used(
    given: list[str], said: str, tmp_path: Path, short: Path
) -> None:
    arguments = ["track", str(short), "--circle", CIRCLE, "--frames", "0:2", "--no-report", "--quiet"]
    assert main([*arguments, "--out", str(tmp_path / "result"), *given]) == 0
    warnings = json.loads((tmp_path / "result" / "summary.json").read_text())["warnings"]
    found = [sentence for sentence in warnings if "implausible" in sentence]
    assert len(found) == (1 if said else 0)
    assert said in " ".join(found)
    assert all("mm" in sentence for sentence in found)


def test_a_rotation_without_texture_stays_empty_in_the_table(tmp_path: Path) -> None:
    plain = ray_caster.Pattern(torch.full((8, 8, 8), 200.0))
    centres = torch.tensor([[40.0, 50.0], [43.0, 50.5], [46.0, 51.0], [49.0, 51.5]])
    images = ray_caster.render(plain, centres, 25.0, torch.eye(3).expand(4, 3, 3), 20.0, shape=(100, 120))
    noise = torch.randn(images.shape, generator=torch.Generator().manual_seed(0))
    np.save(tmp_path / "plain.npy", (images + noise).numpy())
    assert main(["track", str(tmp_path / "plain.npy"), "--out", str(tmp_path / "out"), *FAST]) == 0
    _, table = rows(tmp_path / "out" / "track.csv")
    assert {row["status"] for row in table} == {"weak_texture"}
    assert all(row["wx_rad"] == "nan" and row["sd_wy_rad"] == "nan" for row in table)
    # The outline of a plain ball of this size and contrast is accurate to a hundredth of a px.
    assert all(float(row["dx_px"]) == pytest.approx(3.0, abs=0.03) for row in table[1:])


def test_a_rotation_outside_the_model_is_empty_everywhere(tmp_path: Path, demo_shot: demo.Shot) -> None:
    path, out = tmp_path / "shot.tif", tmp_path / "out"
    tifffile.imwrite(path, demo_shot.images[16:50], photometric="minisblack")
    scale = ["--fps", "36000", "--diameter-mm", "30", "--mass-g", "110"]
    assert main(["track", str(path), "--out", str(out), *scale, "--model", "translation", "--quiet"]) == 0
    _, table = rows(out / "track.csv")
    assert {row["status"] for row in table} == {"weak_texture"}
    assert all(row[name] == "nan" for row in table for name in ("wx_rad", "wy_rad", "wz_rad", "sd_wx_rad"))
    assert all(np.isfinite(float(row[name])) for row in table[1:] for name in ("dx_px", "sd_dy_px", "x_px"))
    assert all(row["qw"] == "nan" for row in table[1:])
    _, si = rows(out / "kinematics.csv")
    assert all(row["wx_rad_s"] == "nan" and np.isfinite(float(row["fx_N"])) for row in si)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["mean_motion"]["increment_px_rad"][2:] == [None] * 3
    assert summary["impact"]["spin_before"]["value"] == [None] * 3
    assert summary["impact"]["energy_before"]["value"] > 0
    assert summary["impact"]["energy_given"]["value"] is None
    said = " ".join(summary["warnings"])
    assert "measures none" in said
    assert "not fully measured" not in said
    page = html.unescape((out / "report.html").read_text())
    assert "the model 'translation' knows none" in page
    assert "Put a pattern of spots" not in page
    assert "nan" not in page.split("<script")[0].lower()
    # Images keep their residual, which shows the motion outside the model.
    assert read(out).sampled.has_residual[1:].all()  # type: ignore[union-attr]


def test_a_recording_that_begins_in_the_contact_has_no_impact_but_says_the_speed_after_it(
    tmp_path: Path, demo_shot: demo.Shot
) -> None:
    # The contact lasts from frame 26.3 to 38.3; the ball would seem to gain 38 J in a contact of its second half.
    path, out = tmp_path / "late.tif", tmp_path / "out"
    tifffile.imwrite(path, demo_shot.images[32:], photometric="minisblack")
    scale = ["--fps", "36000", "--diameter-mm", "30", "--mass-g", "110"]
    assert main(["track", str(path), "--out", str(out), *scale, "--no-report", "--quiet"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["impact"] is None
    (sentence,) = (text for text in summary["warnings"] if text.startswith("No impact is reported: "))
    assert "the flight before the contact: 3 are needed" in sentence
    value, sd = map(float, re.findall(r"The speed after it is ([\d.]+) ± ([\d.]+) m/s", sentence)[0])
    assert abs(value - demo.true_impact()["speed_after"]) < 3 * sd


def test_images_missing_from_a_flight_are_warned_of(tmp_path: Path, demo_shot: demo.Shot) -> None:
    # Without the warning their step would seem to be an impact of 4 MN.
    path, out = tmp_path / "gap.tif", tmp_path / "out"
    tifffile.imwrite(path, np.delete(demo_shot.images[:24], slice(15, 18), axis=0), photometric="minisblack")
    assert main(["track", str(path), "--out", str(out), "--no-report", "--quiet"]) == 0
    warnings = json.loads((out / "summary.json").read_text())["warnings"]
    assert any("3 before frame 15" in sentence for sentence in warnings)
