"""The order of the remarks on a plan."""

from dataclasses import replace

import numpy as np
import pytest
from plan_setups import SMALL

from torchsphere.planning.expected import differences
from torchsphere.planning.plan import Plan
from torchsphere.planning.presentation import remarks
from torchsphere.planning.rehearsal import Target


def test_too_much_blur_is_the_first_remark() -> None:
    setup = replace(SMALL, speed_m_s=180.0, shutter_s=2.77e-5)
    plain = differences(np.eye(5), setup.frame_rate, setup.m_per_px, setup.mass_kg)
    made = Plan(setup, "-", Target(2e-4, 0.3, "given"), np.eye(5), plain, None, None, np.zeros((0, 2)), None)
    assert setup.blur_px == pytest.approx(5.98, abs=0.01)
    # 5 px at 180 m/s and 1.2 px/mm.
    assert "exposure to 23.1 us" in remarks(made)[0]
    assert "exposure" not in remarks(replace(made, setup=replace(setup, shutter_s=2.3e-5)))[0]
