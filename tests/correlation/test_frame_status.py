"""The status of pairs and frames: one word for what was found, and one module that says it."""

import ast
from pathlib import Path

import numpy as np
import pytest
import torch

import torchsphere
from torchsphere.correlation import frame_status
from torchsphere.correlation.frame_status import STATUSES, of_frame, of_pairs, words

PACKAGE = Path(torchsphere.__file__).parent


def test_no_other_module_of_the_measurement_names_a_status() -> None:
    named = {
        path.name
        for package in ("correlation", "sphere_map", "tracking", "errors", "motion")
        for path in (PACKAGE / package).glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and node.value in STATUSES
    }
    assert named == {"frame_status.py"}


def pair(**given: bool) -> str:
    """Status of one pair in which all is good but what is given."""
    good = {"is_alike": True, "converged": True, "has_texture": True, "is_in_view": True, "is_known": True}
    return str(words(of_pairs(**{name: torch.tensor([value]) for name, value in (good | given).items()}))[0])


def test_each_reason_has_its_word_and_the_one_that_explains_the_others_counts() -> None:
    assert pair() == "ok"
    failed: dict[str, bool] = {}
    reasons = {
        "is_alike": "low_correlation",
        "converged": "not_converged",
        "has_texture": "weak_texture",
        "is_in_view": "out_of_frame",
        "is_known": "lost",
    }
    for reason, word in reasons.items():
        failed[reason] = False
        assert pair(**{reason: False}) == word
        assert pair(**failed) == word


def test_images_without_contrast_have_a_weak_texture_whatever_else_failed() -> None:
    status = torch.tensor([STATUSES.index(word) for word in ("ok", "low_correlation", "not_converged")])
    flat = frame_status.of_flat_images(status, torch.tensor([False, True, True]))
    assert words(flat).tolist() == ["ok", "weak_texture", "weak_texture"]


def test_a_pair_whose_ways_disagree_has_not_converged_and_else_takes_the_way_back() -> None:
    back = np.array(["ok", "ok", "low_correlation"])
    assert frame_status.of_both_ways(back, np.array([False, True, False])).tolist() == [
        "ok",
        "not_converged",
        "low_correlation",
    ]


def test_a_failed_pair_with_values_that_are_not_finite_is_lost_and_a_good_one_is_not() -> None:
    status = np.array(["ok", "out_of_frame", "not_converged", "not_converged"])
    found = frame_status.of_unknown_values(status, np.array([False, False, False, True]))
    assert found.tolist() == ["ok", "out_of_frame", "lost", "not_converged"]


@pytest.mark.parametrize(
    ("word", "found", "expected"),
    [
        ("ok", {"is_placed": True, "has_step": True}, "ok"),
        # Found again after a gap, by its texture or by its outline.
        ("ok", {"is_placed": True}, "lost"),
        ("not_converged", {"is_placed": True}, "lost"),
        # A plain ball has a step by its outlines.
        ("weak_texture", {"is_placed": True, "has_step": True, "is_plain": True}, "weak_texture"),
        ("weak_texture", {"is_plain": True}, "lost"),
        ("weak_texture", {}, "low_correlation"),
        ("not_converged", {"has_left": True}, "out_of_frame"),
        # Only the flight tells that a ball has left, and not a pair that lies at the edge.
        ("out_of_frame", {}, "lost"),
        ("low_correlation", {}, "low_correlation"),
    ],
)
def test_a_frame_that_was_measured_by_itself_has_the_word_for_what_was_found(
    word: str, found: dict[str, bool], expected: str
) -> None:
    nothing = {"is_placed": False, "has_step": False, "is_plain": False, "has_left": False}
    assert of_frame(word, **(nothing | found)) == expected


def test_frames_that_are_left_out_are_lost_and_those_without_a_rotation_have_a_weak_texture() -> None:
    status = frame_status.of_unmeasured(3)
    assert status.tolist() == ["lost"] * 3
    status[:2] = "ok"
    assert frame_status.without(status, np.array([True, False, False])).tolist() == ["lost", "ok", "lost"]
    assert frame_status.without_rotation(status).tolist() == ["weak_texture", "weak_texture", "lost"]
    # The longest word fits.
    status[0] = "low_correlation"
    assert status[0] == "low_correlation"
