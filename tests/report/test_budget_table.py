"""The table of the budget in the report: results, sources and whole per cent."""

import dataclasses

from torchsphere.dynamics.budget import RESULTS, SOURCES
from torchsphere.report import pages, summary_tables
from torchsphere.results.reader import ResultFolder


def with_budget(result: ResultFolder, budget: dict[str, dict[str, float]]) -> ResultFolder:
    impact = result.summary["impact"] | {"budget": budget}
    return dataclasses.replace(result, summary=result.summary | {"impact": impact})


def test_a_row_per_result_has_the_shares_of_all_sources_with_an_effect(result: ResultFolder) -> None:
    shares = {"noise": 0.623, "radius": 0.374, "scale": 0.0, "centre": 0.003, "mass": 0.0}
    table = summary_tables.budget_table(with_budget(result, {"peak_force": shares, "duration": {"noise": 1.0}}))
    assert table is not None
    assert table.columns == ("noise of the images", "radius of the outline", "centre of the outline")
    assert table.rows == (("Largest force", "62", "37", "< 1"), ("Contact lasts", "100", "-", "-"))


def test_every_source_and_result_of_a_budget_has_a_name(result: ResultFolder) -> None:
    assert set(summary_tables.SOURCES) == set(SOURCES)
    table = summary_tables.budget_table(with_budget(result, {name: {"noise": 1.0} for name in RESULTS}))
    assert table is not None
    assert not [row[0] for row in table.rows if "_" in row[0]]


def test_a_result_of_an_earlier_version_has_no_table(result: ResultFolder) -> None:
    earlier = {name: value for name, value in result.summary["impact"].items() if name != "budget"}
    old = dataclasses.replace(result, summary=result.summary | {"impact": earlier})
    assert summary_tables.budget_table(old) is None
    assert "Where the uncertainty of the impact comes from" not in pages.report_html(old)
    assert summary_tables.budget_table(dataclasses.replace(result, summary=result.summary | {"impact": None})) is None


def test_the_measured_impact_has_a_table_whose_rows_add_up(result: ResultFolder) -> None:
    table = summary_tables.budget_table(result)
    assert table is not None
    assert "mass" not in table.columns
    for _, *shares in table.rows:
        # Whole per cent: each is off by up to a half.
        assert abs(sum(float(text) for text in shares if text.isdigit()) - 100) <= len(shares)
    assert '<th scope="col">noise of the images</th>' in pages.report_html(result)
