"""Methods of results whose work lies in packages above them: tables, figures, pages and folders.

A track can be plotted and saved, but `torchsphere.tracking` must not import the figures. Its methods call `present`,
and the package's ``__init__`` names the function for each kind of work: it is imported with the first call.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

_functions: dict[str, Callable[[str], Callable[..., Any]]] = {}


def register(names: Mapping[str, str], load: Callable[[str, str], Any]) -> None:
    """Name the functions: work -> module, which has a function of the name of the work; ``load`` imports it."""
    for work, module in names.items():
        _functions[work] = functools.partial(load, module)


def present(work: str, subject: object, *arguments: Any, **options: Any) -> Any:
    """Do the ``work``, such as "plot", on a result."""
    return _functions[work](work)(subject, *arguments, **options)
