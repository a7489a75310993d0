"""Modes of a camera: the best one, reasons against the others, and tables that cannot be read."""

from dataclasses import replace
from pathlib import Path

import pytest
from plan_setups import SMALL, sides

from torchsphere.planning import plan
from torchsphere.planning.rehearsal import Target

pytestmark = pytest.mark.usefixtures("few_recordings")


def test_a_mode_that_cannot_show_the_ball_or_the_contact_is_left_out_with_its_reason() -> None:
    setup, target = replace(SMALL, noise=2.0), Target(3e-4, 0.3, "given")

    def assessed(width: int, height: int, rate: float) -> plan.Assessment:
        return plan.assess(plan.Mode(width, height, rate), sides, setup, target)

    low, tiny, slow, good = (assessed(*m) for m in ((256, 24, 4e4), (37, 64, 4e4), (256, 64, 9e3), (256, 64, 4e4)))
    assert "does not fit" in low.reason
    assert "in view" in tiny.reason
    assert "2.7 images during the contact" in slow.reason
    assert good.reason == ""
    assert plan.best([low, tiny, slow, good]) is good
    assert plan.best([low, slow]) is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("width,height\n1,2\n", "no column width_px"),
        ("width_px,height_px,fps_max\n", "lists no mode"),
        ("width_px,height_px,fps_max\n512,x,3\n", "line 2"),
        ("width_px,height_px,fps_max\n512,128,0\n", "line 2"),
    ],
)
def test_a_table_of_modes_that_cannot_be_used_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "modes.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=words):
        plan.read_modes(path)
