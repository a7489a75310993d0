"""Frozen dataclasses from plain tables (TOML, JSON), by their fields and type hints, and back."""

from __future__ import annotations

import dataclasses
import difflib
import types
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

T = TypeVar("T")

_WORDS: dict[Any, str] = {float: "a number", int: "a whole number", str: "a text in quotes", bool: "true or false"}


class BadFieldError(ValueError):
    """A field is invalid; the message is a sentence that begins with the field's path."""


def build(cls: type[T], table: Any, path: str = "") -> T:
    """An instance of a dataclass from a table.

    Parameters
    ----------
    cls : type
        A dataclass with fields of the types float, int, str, bool, such a dataclass, a tuple of any of these types, or
        ``X | None``.
    table : mapping
        Values by field name; lists for tuples, tables for dataclasses.
    path : str
        Path of the table, for the messages.

    Raises
    ------
    BadFieldError
        If a field is not known, missing, or invalid.
    """
    if not isinstance(table, Mapping):
        raise BadFieldError(f"{path} = {table!r}: expected a table [{path}]")
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init}  # type: ignore[arg-type]  # cls is a dataclass
    hints = get_type_hints(cls)
    for name in table:
        if name not in fields:
            raise BadFieldError(f"{_join(path, name)} is not known: {suggestion(str(name), fields)}")
    for name, field in fields.items():
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if required and name not in table:
            raise BadFieldError(f"{_join(path, name)} is missing: expected {_words(hints[name])}")
    values = {name: _value(hints[name], value, _join(path, name)) for name, value in table.items()}
    try:
        return cls(**values)
    except ValueError as error:
        raise BadFieldError(_join(path, str(error))) from error


def suggestion(name: str, known: Sequence[str] | Mapping[str, Any]) -> str:
    """A sentence with the names nearest to an unknown name."""
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    return f"did you mean {' or '.join(near)}?" if near else f"expected one of {', '.join(known)}"


def plain(value: Any) -> Any:
    """The table from which `build` makes the value; fields that are None are left out."""
    if dataclasses.is_dataclass(value):
        named = {f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.init}
        return {name: plain(part) for name, part in named.items() if part is not None}
    return [plain(part) for part in value] if isinstance(value, tuple) else value


def _value(hint: Any, value: Any, path: str) -> Any:
    if get_origin(hint) in (Union, types.UnionType):
        # Only ``X | None`` occurs, and a table has no word for None.
        hint = next(part for part in get_args(hint) if part is not type(None))
    if dataclasses.is_dataclass(hint):
        return build(hint, value, path)  # type: ignore[arg-type]  # a class, not an instance
    if get_origin(hint) is tuple:
        return _tuple(hint, value, path)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    # A bool is an instance of int.
    if type(value) is not hint:
        raise BadFieldError(f"{path} = {value!r}: expected {_words(hint)}")
    return value


def _tuple(hint: Any, value: Any, path: str) -> tuple[Any, ...]:
    parts = get_args(hint)
    if not isinstance(value, (list, tuple)):
        raise BadFieldError(f"{path} = {value!r}: expected {_words(hint)}")
    if parts[-1] is Ellipsis:
        parts = (parts[0],) * len(value)
    if len(parts) != len(value):
        raise BadFieldError(f"{path} = {value!r}: expected {_words(hint)}, got {len(value)}")
    return tuple(_value(part, v, f"{path}[{i}]") for i, (part, v) in enumerate(zip(parts, value, strict=True)))


def _words(hint: Any) -> str:
    if get_origin(hint) in (Union, types.UnionType):
        hint = next(part for part in get_args(hint) if part is not type(None))
    if get_origin(hint) is tuple:
        parts = get_args(hint)
        kind = {float: "numbers", int: "whole numbers", str: "texts"}.get(parts[0], "tables")
        return f"a list of {kind}" if parts[-1] is Ellipsis else f"a list of {len(parts)} {kind}"
    return _WORDS.get(hint, "a table")


def _join(path: str, name: Any) -> str:
    return f"{path}.{name}" if path else str(name)
