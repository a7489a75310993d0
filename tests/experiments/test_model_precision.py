"""The study of the forward model's precision: its judgement of known errors, and its cache of frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.validation import model_precision as study
from experiments.validation.model_precision import Found, Tracked

STEPS = 400


def of_errors(name: str, error: np.ndarray, stated: np.ndarray) -> Found:
    """Three recordings with the same errors (n, 5) and the same stated standard deviations (5,), px and deg."""
    part = Tracked(error, np.broadcast_to(stated**2, error.shape), 0.001, 0.001, 0.0, 0.01, 5.0, True, "")
    return Found(name, "true", [part] * 3)


def alternating(size: np.ndarray) -> np.ndarray:
    """Errors (n, 5) of that size without bias."""
    return size * np.where(np.arange(STEPS) % 2, 1.0, -1.0)[:, None]


def verdicts(found: Found) -> dict[str, bool]:
    return {row.claim: row.holds for row in study.rows([found])}


def test_errors_as_stated_and_within_the_limits_hold_every_claim() -> None:
    size = 0.9 * study.MAX_STD
    assert all(verdicts(of_errors("base", alternating(size), size)).values())


def test_the_limit_of_the_deviation_scales_with_noise_and_radius() -> None:
    np.testing.assert_allclose(study.limits("noise-8"), 4 * study.MAX_STD)
    np.testing.assert_allclose(study.limits("radius-100"), study.MAX_STD * [0.5, 0.5, 0.25, 0.25, 0.25])


def test_a_bias_beyond_its_limit_breaks_the_claim_of_its_unit_alone() -> None:
    size = 0.5 * study.MAX_STD
    bias = np.array([0, 0, 0, 0.001, 0])
    biased = of_errors("base", alternating(size) + bias, size)
    assert {claim for claim, holds in verdicts(biased).items() if not holds} == {"bias of a step, deg"}


def test_a_stated_deviation_that_is_a_fifth_too_small_is_seen_in_one_component() -> None:
    size = 0.5 * study.MAX_STD
    found = of_errors("base", alternating(size), size * [1, 0.8, 1, 1, 1])
    assert study.ratios(found.errors)[0] == pytest.approx([1, 0.8, 1, 1, 1])
    assert not verdicts(found)["stated/true of all cases, true circle"]


def test_a_step_that_was_not_measured_counts_for_nothing() -> None:
    size = 0.9 * study.MAX_STD
    error = alternating(size)
    error[10:20] = np.nan
    assert all(verdicts(of_errors("base", error, size)).values())


def test_a_recording_without_a_map_breaks_its_claim() -> None:
    found = of_errors("drift", alternating(study.MAX_STD), study.MAX_STD)
    without = replace(found, tracked=[replace(found.tracked[0], on_map=False, reason="no texture")])
    assert verdicts(found)["poses on a map of the ball"]
    assert not verdicts(without)["poses on a map of the ball"]


@pytest.mark.parametrize("name", ["base", "drift"])
def test_frames_are_rendered_once_and_then_read(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "CACHE", tmp_path)
    monkeypatch.setitem(study.CASES, name, replace(study.CASES[name], radius=10.0, frames=5))
    first = study.shot_of(name, 101)
    monkeypatch.setattr(study, "_keep", lambda *_: pytest.fail("rendered twice"))
    again = study.shot_of(name, 101)
    assert again.images.equal(first.images)
    np.testing.assert_array_equal(again.increment, first.increment)
    # A clean frame is not rounded.
    assert not first.images.equal(first.images.round())


def test_the_drifting_ball_turns_to_its_angle_and_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "CACHE", tmp_path)
    monkeypatch.setitem(study.CASES, "drift", replace(study.DRIFT, radius=10.0, frames=5))
    turned = np.degrees(study.shot_of("drift", 101).increment[:, 2:].cumsum(0))
    assert np.linalg.norm(turned, axis=1) == pytest.approx([90, 180, 90, 0], abs=1e-9)
