"""Cells of text in CSV files that a spreadsheet does not run as formulas."""

from __future__ import annotations

#: First signs of a text that a spreadsheet takes for a formula.
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def neutral_cell(text: str) -> str:
    """The text, behind an apostrophe where a spreadsheet would take the text for a formula."""
    return f"'{text}" if text.lstrip("'").startswith(_FORMULA) else text


def plain_text(cell: str) -> str:
    """The text of a cell that `neutral_cell` wrote."""
    return cell[1:] if cell.startswith("'") and cell.lstrip("'").startswith(_FORMULA) else cell
