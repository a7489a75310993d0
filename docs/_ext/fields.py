"""Classes on the page for Python: their fields, and a signature only where users make objects of them."""

from __future__ import annotations

import dataclasses
import re
from typing import Any, get_type_hints

from sphinx.application import Sphinx

from torchsphere.settings.setting import Setting

#: Classes whose objects a user makes; the program makes those of all others.
MADE_BY_USERS = ("Camera", "Circle", "Options")


def signature(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, given: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """Leave the signature out of classes that a user does not call."""
    if what == "class" and name.rsplit(".", 1)[1] not in MADE_BY_USERS:
        return "", returned
    return given, returned


def attributes(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """List the fields of a dataclass: by its docstring, or else by their names, types and descriptions as settings."""
    if what != "class" or not dataclasses.is_dataclass(obj):
        return
    if "Attributes" in lines:
        lines[:] = _parted(lines)
        return
    settings = [hint.__metadata__ for hint in get_type_hints(obj, include_extras=True).values() if _is_setting(hint)]
    described = iter(settings)
    section = ["", "Attributes", "----------"]
    for field in dataclasses.fields(obj):
        if field.name.startswith("_"):
            continue
        kind = str(field.type)
        if kind.startswith("Annotated["):
            kind = re.sub(r",\s*Setting\(.*", "", kind.removeprefix("Annotated["), flags=re.DOTALL).strip()
            section += [f"{field.name} : {kind}", f"    {_described(next(described)[0], field.default)}"]
        else:
            section.append(f"{field.name} : {kind}")
    sections = [number - 1 for number, line in enumerate(lines) if line and set(line) == {"-"}]
    place = sections[0] if sections else len(lines)
    lines[place:place] = [*section, ""]


def _parted(lines: list[str]) -> list[str]:
    """Give each of the fields in ``a, b : type`` an entry of its own, which napoleon does for parameters only."""
    parted: list[str] = []
    names: list[str] = []
    entry: list[str] = []
    for line in [*lines, "end"]:
        if names and not line.startswith(" "):
            for name in names:
                parted += [f"{name} : {entry[0]}", *entry[1:]]
            names = []
        heading = re.fullmatch(r"(\w+(?:, \w+)+) : (.*)", line)
        if heading:
            names, entry = heading[1].split(", "), [heading[2]]
        elif names:
            entry.append(line)
        else:
            parted.append(line)
    return parted[:-1]


def _described(setting: Setting, default: Any) -> str:
    negative = "False: " if setting.flag.startswith("--no-") else ""
    choices = f"; one of {', '.join(setting.kind.names)}" if setting.kind.names else ""
    text = re.sub(r"(--[a-z-]+)", r"``\1``", setting.help)
    return f"{negative}{text}{choices}. Default ``{default!r}``."


def _is_setting(hint: Any) -> bool:
    return any(isinstance(note, Setting) for note in getattr(hint, "__metadata__", ()))


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the two to autodoc, before its docstrings are parsed."""
    app.connect("autodoc-process-signature", signature)
    app.connect("autodoc-process-docstring", attributes, priority=100)
    return {"parallel_read_safe": True}
