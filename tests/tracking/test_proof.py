"""What proves that a circle which was found is the outline of a ball."""

import dataclasses

import pytest
from tracks import falling_track

import torchsphere as ts
from torchsphere.motion.findings import UNKNOWN_MAP, Findings
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.tracking.proof import lacking_proof, require_proof


def track(*, scatter: float, circle_given: bool = False, on_map: bool = False) -> ts.Track:
    findings = Findings(map=MadeMap() if on_map else UNKNOWN_MAP, outline_scatter=scatter)
    return dataclasses.replace(falling_track(), settings={"circle_given": circle_given}, findings=findings)


def test_outlines_that_contradict_each_other_are_not_those_of_a_ball() -> None:
    with pytest.raises(ValueError, match=r"radii that differ by 8 %, and no map .* give its outline with circle"):
        require_proof(track(scatter=0.08))


def test_a_small_disc_that_the_next_frames_do_not_show_is_no_ball() -> None:
    # A flake of snow: exact in its own image, and gone.
    flake = ts.Circle(14.4, 196.9, 3.2, 0.1, 0.1, 0.1)
    fallen = dataclasses.replace(track(scatter=0.0), circle=flake)
    assert lacking_proof(fallen) == ""
    gone = dataclasses.replace(fallen, findings=dataclasses.replace(fallen.findings, untried_frames=18))
    with pytest.raises(ValueError, match=r"so small that .*, the frames right after it hardly show the same"):
        require_proof(gone)


@pytest.mark.parametrize(
    "proven",
    [track(scatter=0.01), track(scatter=0.08, circle_given=True), track(scatter=0.08, on_map=True)],
    ids=["alike", "given", "map"],
)
def test_outlines_alike_a_given_circle_or_a_map_are_enough(proven: ts.Track) -> None:
    assert lacking_proof(proven) == ""
    assert lacking_proof(track(scatter=0.08)) != ""
