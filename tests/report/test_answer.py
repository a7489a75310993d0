"""The answer of a report: the numbers under its headline."""

import dataclasses
import math
import re
from typing import Any

import numpy as np
import pytest
from result_folders import in_px

from torchsphere.report import pages
from torchsphere.report.answer import answer
from torchsphere.report.summary_tables import with_sd
from torchsphere.results.reader import ResultFolder


def with_summary(result: ResultFolder, **changes: Any) -> ResultFolder:
    return dataclasses.replace(result, summary=result.summary | changes)


def test_an_impact_is_answered_by_speeds_force_spin_and_restitution_with_their_deviations(result: ResultFolder) -> None:
    found, impact = answer(result), result.summary["impact"]
    assert found is not None
    assert found.about == "The impact"
    assert [name for name, _ in found.numbers] == [
        "Speed before",
        "Speed after",
        "Largest force",
        "Spin before",
        "Spin after",
        "Restitution",
    ]
    values = dict(found.numbers)
    # The demo's ball flies at 71.66 m/s, is pushed with 54 kN and turns by 26.93 rev/s.
    assert float(values["Speed before"].split(" ")[0]) == pytest.approx(71.66, abs=0.1)
    assert float(values["Largest force"].split(" ")[0]) == pytest.approx(54.0, abs=1.5)
    assert float(values["Spin before"].split(" ")[0]) == pytest.approx(26.93, abs=1.0)
    force = impact["peak_force"]
    assert values["Largest force"] == with_sd(force["value"], force["sd"], "kN", 1e-3)
    assert all(" ± " in text for text in values.values())


def test_what_is_not_known_of_an_impact_is_left_out(result: ResultFolder) -> None:
    impact = {name: value for name, value in result.summary["impact"].items() if name != "peak_force"}
    impact |= {"spin_rate_after": {"value": None, "sd": None, "unit": "rev/s"}}
    found = answer(with_summary(result, impact=impact))
    assert [name for name, _ in found.numbers] == ["Speed before", "Speed after", "Spin before", "Restitution"]
    several = answer(with_summary(result, impacts=[impact] * 3))
    assert several.about == "The strongest of 3 impacts"


def test_a_flight_is_answered_by_speed_and_spin_and_by_why_there_is_no_impact(result: ResultFolder) -> None:
    means = {"velocity_m_s": [3.0, -4.0], "sd_velocity_m_s": [0.1, 0.1]}
    means |= {"spin_rad_s": [0.0, 0.0, 2 * math.pi], "sd_spin_rad_s": [9.0, 9.0, 0.2 * math.pi]}
    found = answer(with_summary(result, impact=None, impacts=[], mean_motion=means, warnings=[]))
    assert found.numbers == (("Speed", "5.00 ± 0.10 m/s"), ("Spin", "1.00 ± 0.10 rev/s"))
    why = "No impact is reported: No contact was found: one steady motion explains all frames as well."
    found = answer(with_summary(result, impact=None, impacts=[], mean_motion=means, warnings=[why]))
    assert found.reason == "No impact: no contact was found: one steady motion explains all frames as well."


def test_without_rate_and_scale_the_answer_is_in_px_and_degrees(result: ResultFolder) -> None:
    turn = [math.radians(value) for value in (0.3, 0.0, -0.4)]
    means = {"increment_px_rad": [3.0, 4.0, *turn], "sd_increment_px_rad": [0.01, 0.01, *[math.radians(0.01)] * 3]}
    found = answer(with_summary(in_px(result), impact=None, impacts=[], mean_motion=means))
    assert found.numbers == (("Step", "5.000 ± 0.010 px per frame"), ("Turn", "0.500 ± 0.010 deg per frame"))
    assert found.reason == ""
    without_rotation = {"increment_px_rad": [3.0, 4.0, None, None, None], "sd_increment_px_rad": [None] * 5}
    found = answer(with_summary(in_px(result), impact=None, impacts=[], mean_motion=without_rotation))
    assert found.numbers == (("Step", "5 px per frame"),)


def test_a_result_in_which_nothing_usable_was_measured_has_no_answer(result: ResultFolder) -> None:
    lost = dataclasses.replace(result, status=np.array(["lost"] * len(result.status)))
    assert answer(lost) is None
    assert 'class="answer"' not in pages.report_html(lost)


def test_the_answer_stands_under_the_headline_and_below_what_makes_numbers_wrong(result: ResultFolder) -> None:
    text = pages.report_html(with_summary(result, warnings=["It is wrong."], warning_levels=["severe"]))
    places = [text.index(mark) for mark in ('id="verdict"', "It is wrong.", 'class="answer"', 'id="frame"')]
    assert places == sorted(places)
    row = re.search(r'<section class="answer".*?</section>', text, re.DOTALL)[0]
    assert row.count("<dt>") == 6
    assert row.count("±") == 6
