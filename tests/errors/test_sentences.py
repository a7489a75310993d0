"""The warnings of a track: on the track itself, in the log, and the same in the summary."""

import dataclasses
import json
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shots
import tifffile
import torch

import torchsphere as ts
from torchsphere.cli.main import main
from torchsphere.errors import map_radius
from torchsphere.runtime import warning_levels
from torchsphere.runtime.setting_names import as_options
from torchsphere.sphere_map import radius_error
from torchsphere.synthetic import ray_caster

#: Of sentences that read the track alone.
NO_EVIDENCE: Any = None


@pytest.fixture(scope="module")
def images() -> np.ndarray:
    """Six images of a flying ball, of which the third repeats the second."""
    made = shots.shot(0, n=6, radius=25.0).images.numpy().astype(np.uint8)[:, 70:180, 20:160]
    made[3] = made[2]
    return np.ascontiguousarray(made)


def test_warnings_reach_python_by_the_track_and_by_the_log(
    images: np.ndarray, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, logger="torchsphere"):
        track = ts.track(images, first_frame=7)
    assert any("repeat the image before them bit for bit" in said and said.endswith(": 10.") for said in track.warnings)
    assert [(r.name, r.levelname, r.getMessage()) for r in caplog.records] == [
        ("torchsphere", "WARNING", said) for said in track.warnings
    ]
    caplog.clear()
    assert ts.track(images, first_frame=7, log=False).warnings == track.warnings
    assert not caplog.records


def test_the_command_line_prints_the_warnings_of_the_track_and_logs_none(
    images: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    tifffile.imwrite(tmp_path / "shot.tif", images, photometric="minisblack")
    assert main(["track", str(tmp_path / "shot.tif"), "--out", str(tmp_path / "out"), "--no-report"]) == 0
    said = ts.track(images, log=False).warnings
    assert said
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
    printed = capsys.readouterr()
    # Python names arguments, the command line options.
    assert any("`" in sentence for sentence in said)
    said = tuple(map(as_options, said))
    assert [sentence for sentence in summary if sentence in said] == list(said)
    assert all(printed.out.count(f"  {sentence}\n") == 1 for sentence in said)
    assert not any(sentence in printed.err for sentence in said)
    assert not caplog.records


def test_a_radius_that_the_outline_contradicts_is_a_severe_warning_with_its_effect(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(radius_error, "by_outline", lambda radius, orientation, start: 2.0)
    track = ts.track(shots.shot(0, n=14, radius=25.0, start=(60.0, 60.0)).images[:, :130, :150], log=False)
    (said,) = (sentence for sentence in track.warnings if "The radius on the map of the ball" in sentence)
    assert warning_levels.level_of(said) == "severe"
    assert track.circle.sd_radius > 2.0
    # Whatever widens the error, as a ball that is often hidden, the sentence tells the one that the track states.
    for factor in (1, 2):
        circle = track.circle.with_errors(factor)
        (said,) = map_radius.sentences(dataclasses.replace(track, circle=circle), NO_EVIDENCE)
        assert f"may be {circle.sd_radius:.2g} px off" in said
        assert f"wrong by {100 * circle.sd_radius / circle.radius:.2g} %, which their errors include" in said


def test_the_turn_by_the_cameras_distance_is_within_the_stated_errors() -> None:
    images = shots.shot(0, n=8, radius=25.0, start=(60.0, 60.0)).images[:, :130, :150]
    track = ts.track(images, (60.0, 60.0, 25.0), sphere_map=False, log=False)
    (said,) = (sentence for sentence in track.warnings if "The camera's distance" in sentence)
    shown = float(re.search(r"by the same ([\d.e-]+) deg per frame", said)[1])
    stated = np.degrees(track.sd_steady[2:]).max()
    # Two digits are shown; other steady errors add to the turn's.
    assert 0.5 * stated < shown < 1.05 * stated


@pytest.mark.parametrize(("radius", "is_said"), [(20.0, False), (20.8, True)])
def test_a_wrong_circle_that_is_given_to_a_ball_that_hardly_turns_is_named_although_a_map_agrees(
    radius: float, is_said: bool
) -> None:
    turned = torch.tensor([0.0, np.radians(0.05), 0.0], dtype=torch.float64)
    poses = torch.stack([shots.rotation_matrix(i * turned) for i in range(20)]).float()
    centres = torch.tensor([[40.0 + 2 * i, 40.0] for i in range(20)])
    clean = ray_caster.render(shots.speckle(1, 20.0), centres, 20.0, poses, 20.0, shape=(80, 120))
    track = ts.track(shots.noisy(clean, 2.0, 9), (40.0, 40.0, radius), log=False)
    assert track.findings.is_on_map
    said = [sentence for sentence in track.warnings if "is not the outline that the image shows" in sentence]
    assert bool(said) == is_said
    assert all(warning_levels.level_of(sentence) == "severe" for sentence in said)
