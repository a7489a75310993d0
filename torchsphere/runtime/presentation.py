"""Methods of results whose work lies in packages above them: tables, figures, pages and folders.

A track can be plotted and saved, but `torchsphere.tracking` must not import the figures. Its methods call `present`,
and the package's ``__init__`` names the function for each kind of work: it is imported with the first call.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_functions: dict[str, Callable[[str], Callable[..., Any]]] = {}


def register(names: Mapping[str, str], load: Callable[[str, str], Any]) -> None:
    """Name the functions: work -> module, which has a function of the name of the work; ``load`` imports it."""
    for work, module in names.items():
        _functions[work] = functools.partial(load, module)


def present(work: str, subject: object, *arguments: Any, **options: Any) -> Any:
    """Do the ``work``, such as "plot", on a result."""
    return _functions[work](work)(subject, *arguments, **options)


class Presented:
    """A result that a notebook shows as a small figure or table."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return str(present("html", self))


class Tabulated(Presented):
    """A result with a row per frame: its tables and figures."""

    __slots__ = ()

    def to_pandas(self) -> Any:
        """The columns of the result's CSV table as a `pandas.DataFrame`, a row per frame.

        ``attrs["units"]`` has their units.

        Raises
        ------
        OSError
            If pandas is not installed.
        """
        return present("to_pandas", self)

    def to_xarray(self) -> Any:
        """The columns of the result's CSV table as an `xarray.Dataset`, with units in its attributes.

        That of a track has the covariances of its steps, too.

        Raises
        ------
        OSError
            If xarray is not installed.
        """
        return present("to_xarray", self)

    def plot(self, kind: str = "motion") -> Figure:
        """A figure of the report: "motion", "rotation" or "quality"; px and degrees for a track, SI units for a motion.

        Raises
        ------
        ValueError
            If there is no such figure.
        """
        figure: Figure = present("plot", self, kind)
        return figure
