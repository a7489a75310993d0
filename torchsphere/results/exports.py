"""All tables of a result in one file for other programs: HDF5, and MAT for MATLAB and Octave, with names and units.

In HDF5 a table is a group, and a column a data set with the attribute ``unit``. In a MAT file a table is a struct of
columns, whose field ``units`` is a struct of texts. A number of an impact has its standard deviation and its unit.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from torchsphere.recording.refusal import LibraryMissingError
from torchsphere.results.columns import Columns, unit_of
from torchsphere.settings.choices import EXPORTS

#: Unit of the covariances, beside those of columns by `unit_of`.
COVARIANCE_UNIT = "px and rad: dx, dy, wx, wy, wz"

#: Longest name of a field in a MAT file.
_LONGEST_FIELD = 63


def check_exports(kinds: Sequence[str]) -> None:
    """Raise ValueError for an unknown kind of file, and LibraryMissingError if the library of one is not installed."""
    for kind in kinds:
        if kind not in EXPORTS:
            raise ValueError(f"export = {kind!r}: expected one of {', '.join(EXPORTS)}")
    if "hdf5" in kinds and importlib.util.find_spec("h5py") is None:
        raise LibraryMissingError("HDF5 needs h5py, which is not installed: pip install 'torchsphere[export]'")


def write_export(
    path: Path,
    kind: str,
    tables: Mapping[str, Columns],
    impacts: Sequence[Mapping[str, Any]] = (),
    summary: Mapping[str, Any] | None = None,
) -> None:
    """Write the tables to a file of this kind, one of `EXPORTS`.

    ``tables`` has columns (n, ...) by the names of the tables, ``impacts`` and ``summary`` are those of summary.json,
    without NaN. Raises as `check_exports`.
    """
    check_exports([kind])
    text = "" if summary is None else json.dumps(summary, ensure_ascii=False)
    writers: dict[str, Callable[..., None]] = {"hdf5": _write_hdf5, "mat": _write_mat}
    writers[kind](path, tables, impacts, text)


def _unit(name: str) -> str:
    return COVARIANCE_UNIT if name == "covariance" else unit_of(name)


def _is_number(item: Any) -> bool:
    """Whether an item of an impact is a number or vector with its unit."""
    return isinstance(item, Mapping) and {"value", "sd", "unit"} <= item.keys()


def _write_hdf5(path: Path, tables: Mapping[str, Columns], impacts: Sequence[Mapping[str, Any]], text: str) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, columns in tables.items():
            group = file.create_group(name)
            # The order of the columns is that of the table.
            group.attrs["columns"] = list(columns)
            for column, values in columns.items():
                kind = h5py.string_dtype() if values.dtype.kind in "UO" else None
                data = group.create_dataset(column, data=values.astype(object) if kind else values, dtype=kind)
                data.attrs["unit"] = _unit(column)
        for number, impact in enumerate(impacts, start=1):
            _fill_group(file.create_group(f"impacts/{number}"), impact)
        if text:
            file.create_dataset("summary", data=text, dtype=h5py.string_dtype())


def _fill_group(group: Any, items: Mapping[str, Any]) -> None:
    """Write numbers as data sets with ``sd`` and ``unit``, texts and counts as attributes, and groups of them."""
    for name, item in items.items():
        if _is_number(item):
            data = group.create_dataset(name, data=_as_number(item["value"]))
            data.attrs["sd"], data.attrs["unit"] = _as_number(item["sd"]), item["unit"]
        elif isinstance(item, Mapping):
            _fill_group(group.create_group(name), item)
        elif isinstance(item, (list, tuple)):
            group.attrs[name] = "\n".join(map(str, item))
        elif item is not None:
            group.attrs[name] = item


def _write_mat(path: Path, tables: Mapping[str, Columns], impacts: Sequence[Mapping[str, Any]], text: str) -> None:
    from scipy.io import savemat

    content: dict[str, Any] = {name: _struct(columns) for name, columns in tables.items()}
    cells = np.empty(len(impacts), dtype=object)
    cells[:] = [_matlab(impact) for impact in impacts]
    if len(impacts):
        content["impacts"] = cells
    if text:
        content["summary"] = text
    savemat(path, content, appendmat=False, long_field_names=True, do_compression=True, oned_as="column")


def _struct(columns: Columns) -> dict[str, Any]:
    """A table as a struct; words are a cell array."""
    values = {name: v.astype(object) if v.dtype.kind == "U" else v for name, v in columns.items()}
    return {**values, "units": {name: _unit(name) for name in columns}}


def _matlab(item: Any) -> Any:
    """An item of an impact for a struct: NaN for what is not known."""
    if _is_number(item):
        return {"value": _as_number(item["value"]), "sd": _as_number(item["sd"]), "unit": item["unit"]}
    if isinstance(item, Mapping):
        return {name.replace(" ", "_")[:_LONGEST_FIELD]: _matlab(each) for name, each in item.items()}
    if isinstance(item, (list, tuple)):
        return "\n".join(map(str, item))
    return np.nan if item is None else item


def _as_number(value: Any) -> Any:
    """A number, or an array of numbers, from what JSON has: NaN for null."""
    return np.asarray(value, dtype=np.float64)
