"""Length of a vector of ``summary.json`` with its standard deviation."""

from __future__ import annotations

import math
from typing import Any


def vector_length(value: Any, sd: Any = None, part: slice = slice(None)) -> tuple[float | None, float | None]:
    """Length of a ``part`` of a vector, or a number with its sign, and its standard deviation.

    The length is None if a component is unknown, the standard deviation if it is not known, or the length is 0.
    """
    parts, sds = _list(value)[part], _list(sd)[part]
    if not parts or None in parts:
        return None, None
    length = parts[0] if len(parts) == 1 else math.hypot(*parts)
    if length == 0 or len(sds) != len(parts) or None in sds:
        return length, None
    return length, math.hypot(*(part * s / length for part, s in zip(parts, sds, strict=True)))


def _list(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list) else [] if value is None else [value]
