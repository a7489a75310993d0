"""The table of the ledger in the report: what differs from step to step, then what all steps have in common."""

import dataclasses

from torchsphere.motion.ledger import Entry
from torchsphere.report.pages import report_html
from torchsphere.report.summary_tables import LEDGER_COLUMNS, ledger_table
from torchsphere.results.reader import ResultFolder

NOISE = Entry("noise", step=(0.01, 0.02, 0.0, 0.017453292519943295, 0.0), circle=(0.0, 0.0, 0.05), scale=0.001)
VIEW = Entry("view", steady=(0.0, 0.0, 0.0, 0.0, 0.0017453292519943296))


def with_ledger(result: ResultFolder, *entries: Entry) -> ResultFolder:
    summary = result.summary | {"ledger": [entry.items() for entry in entries]}
    return dataclasses.replace(result, summary=summary)


def test_rotations_are_in_degrees_and_the_scale_in_per_cent(result: ResultFolder) -> None:
    table = ledger_table(with_ledger(result, VIEW, NOISE))
    assert table is not None
    assert table.columns == LEDGER_COLUMNS
    assert table.rows == (
        ("noise", "0.01", "0.02", "-", "1", "-", "-", "-", "0.05", "0.1"),
        ("view: all steps alike", "-", "-", "-", "-", "0.1", "-", "-", "-", "-"),
    )


def test_a_result_of_an_earlier_version_has_no_table(result: ResultFolder) -> None:
    earlier = {name: value for name, value in result.summary.items() if name != "ledger"}
    without = dataclasses.replace(result, summary=earlier)
    assert ledger_table(without) is None
    assert "Where the uncertainty of the motion comes from" not in report_html(without)
    assert "Where the uncertainty of the motion comes from" in report_html(with_ledger(result, NOISE))
