"""HTML pages from the Jinja templates in ``templates/``.

Styles and scripts are templates, too: ``{{``, ``{%`` and ``{#`` have Jinja's meaning in them.
"""

from __future__ import annotations

import functools
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment


def page(template: str, **values: Any) -> str:
    """The page of a ``template``, which escapes all ``values``, in its scripts as well.

    Raises ValueError if ``data`` for a script holds NaN or infinity, which JSON does not have.
    """
    return _environment().get_template(template).render(values)


@functools.cache
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.filters["split_at_options"] = re.compile(r"(--[a-z][a-z-]*)").split
    return environment
