"""The report of a result: safe with any file name, and in words where nothing was measured."""

import dataclasses
import html
from pathlib import Path

import numpy as np
import tifffile

from torchsphere.cli.main import main
from torchsphere.report import explanations, report_page
from torchsphere.results.reader import ResultFolder, read
from torchsphere.synthetic import demo_shot


def test_a_report_asks_nothing_from_outside_and_holds_any_name(result: ResultFolder, tmp_path: Path) -> None:
    name = "</script><script>alert(1)</script><!-- &amp; $title {{ title }} {% raw %}.tif"
    source = result.summary["input"] | {"path": f"/shots/{name}"}
    summary = result.summary | {"input": source, "warnings": [f"A warning of {name}."]}
    text = report_page.report_html(dataclasses.replace(result, summary=summary))
    assert "default-src 'none'" in text
    assert "http://" not in text
    assert "https://" not in text
    assert "alert(1)</script>" not in text
    # The data's script and the page's own, and no third.
    assert text.count("</script>") == 2
    assert f"A warning of {html.escape(name)}." in text


def test_options_of_the_command_line_stand_as_code(result: ResultFolder) -> None:
    summary = result.summary | {"warnings": ["Give --mm-per-px <px>, or --fps."]}
    text = report_page.report_html(dataclasses.replace(result, summary=summary))
    assert "<li>Give <code>--mm-per-px</code> &lt;px&gt;, or <code>--fps</code>.</li>" in text


def test_a_recording_in_which_the_ball_is_lost_is_reported_in_words_and_never_as_nan(tmp_path: Path) -> None:
    images = demo_shot.make_shot().images[:8].copy()
    images[1:] = np.random.default_rng(0).integers(55, 66, images[1:].shape)
    tifffile.imwrite(tmp_path / "shot.tif", images, photometric="minisblack")
    arguments = ["track", str(tmp_path / "shot.tif"), "--out", str(tmp_path / "out"), "--circle", "64.3,92.6,40"]
    assert main([*arguments, "--fps", "36000", "--diameter-mm", "30", "--mass-g", "110", "--quiet"]) == 0
    result = read(tmp_path / "out")
    assert (
        explanations.verdict(result) == "No motion was measured: the ball was found in 1 frame of 8, but not followed."
    )
    # A circle was given: to give one is no advice.
    assert not any("--circle" in p.remedy for p in explanations.problems(result))
    assert any("circle that was given" in p.remedy for p in explanations.problems(result))
    assert sum(len(p.remedy) > 0 for p in explanations.problems(result)) == len(explanations.problems(result)) > 0
    text = (tmp_path / "out" / "report.html").read_text()
    assert "nan" not in text.split('id="data"')[0].lower().replace("nano", "")
    assert "not measured: no motion was measured" in text
    assert "steady motion" not in text
    assert "No impact is reported: no motion was measured." in result.summary["warnings"]
    assert not any("steady motion" in sentence for sentence in result.summary["warnings"])
