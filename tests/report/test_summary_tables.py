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


def test_the_energy_balance_is_one_table_with_shares_in_percent(result: ResultFolder) -> None:
    table = summary_tables.energy_table(result)
    assert table is not None
    assert [row[0] for row in table.rows] == ["Translation", "Spin", "Together"]
    assert all(len(row) == 1 + len(table.columns) for row in table.rows)
    total = result.summary["impact"]["energy_balance"]["total"]
    assert table.rows[2][-1] == summary_tables.with_sd(total["share"]["value"], total["share"]["sd"], "%", 100)
    assert table.rows[2][3].endswith(" J")
    assert summary_tables.energy_table(dataclasses.replace(result, summary=result.summary | {"impact": None})) is None


def test_stiffness_and_friction_have_their_sentences_beside_them(result: ResultFolder) -> None:
    number = {"value": 0.25, "sd": 0.01, "unit": "1"}
    friction = {"coefficient": number, "slip_before": number, "slip_after": number, "sentence": "The ball rolls."}
    impact = result.summary["impact"] | {"friction": friction}
    rows = dict(summary_tables.sections(dataclasses.replace(result, summary=result.summary | {"impact": impact}))[0][1])
    assert rows["Tangential / normal impulse"] == "0.250 ± 0.010"
    assert rows["Friction"] == "The ball rolls."
    assert rows["Law of Hertz"] == impact["contact_law"]["sentence"]
    stiffness = impact["contact_law"]["stiffness"]
    assert rows["Contact stiffness (law of Hertz)"].startswith(f"{1e-6 * stiffness['value']:.3g}"[:2])
    assert rows["Contact stiffness (law of Hertz)"].endswith("MN/m^1.5")
    unresolved = {k: v for k, v in impact.items() if k != "contact_law"} | {
        "contact_law_missing": "The contact is short."
    }
    summary = result.summary | {"impact": unresolved}
    rows = dict(summary_tables.sections(dataclasses.replace(result, summary=summary))[0][1])
    assert rows["Contact stiffness"] == "not measured: the contact is short."
