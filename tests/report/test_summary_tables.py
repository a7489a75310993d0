"""Tables of a result: numbers with the digits that their uncertainty allows."""

import dataclasses

import pytest

from torchsphere.report import summary_tables
from torchsphere.results.reader import ResultFolder


def test_means_that_an_earlier_result_lacks_are_not_measured(result: ResultFolder) -> None:
    earlier = dataclasses.replace(result, summary={k: v for k, v in result.summary.items() if k != "mean_motion"})
    (rows,) = (rows for title, rows in summary_tables.sections(earlier) if title == "Mean motion")
    assert [text for _, text in rows] == [summary_tables.NOT_MEASURED] * 2


@pytest.mark.parametrize(
    ("value", "sd", "unit", "text"),
    [
        (71.6234, 0.0493, "m/s", "71.623 ± 0.049 m/s"),
        (0.45654, 0.0008, "", "0.45654 ± 0.00080"),
        ([3.0, -4.0], [0.5, 0.25], "m/s", "(3.00, -4.00) ± (0.50, 0.25) m/s"),
        (40.0, None, "px", "40 px"),
        (None, None, "kN", "not measured"),
        (float("nan"), 1.0, "kN", "not measured"),
    ],
)
def test_numbers_have_the_digits_that_their_uncertainty_allows(value: object, sd: object, unit: str, text: str) -> None:
    values = summary_tables.with_sd(value, sd, unit)
    assert values == text
