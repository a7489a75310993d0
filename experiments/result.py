"""One line of the results: a claim of the paper, its number, ours, and whether the claim holds.

Every experiment of the paper has a function ``rows() -> list[Row]``, which `experiments.all` joins into RESULTS.md.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """What one experiment says about one claim.

    Attributes
    ----------
    experiment : str
        Name of the module: "fig02", "table1".
    claim : str
        What the paper says, in one sentence.
    paper, ours : str
        Numbers with their units, or a few words.
    holds : bool
        Whether ours confirms the claim.
    """

    experiment: str
    claim: str
    paper: str
    ours: str
    holds: bool
