"""The option ``--config-template``: a TOML file with every setting, to begin a file for ``--config`` with."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from torchsphere.settings.configuration import toml_value
from torchsphere.settings.setting import Group, Setting

#: Examples in TOML of settings without a default that a file could state.
EXAMPLES = {
    "circle": "[80.4, 120.7, 50]",
    "frames": '"10:90"',
    "fps": "36000",
    "shutter_us": "5",
    "ignore": '["mask.png", "96,156 113,147 106,128"]',
    "axes": '"hwn"',
    "pixel_aspect": "1.1",
    "bayer": '"RGGB"',
    "roi": "0.95",
    "focal_px": "1200",
    "distance_mm": "500",
    "principal_px": "[191.5, 95.5]",
    "diameter_mm": "30",
    "mm_per_px": "0.375",
    "mass_g": "110",
    "cfc": "1000",
    "shell_mm": "2",
    "inertia_kg_m2": "9.9e-6",
    "normal_deg": "180",
}

HEAD = """# Settings for torchsphere {command}: take away the '#' before a name to use it, then --config THIS-FILE.toml.
# A value is the default where there is one, else an example. Options of the command line win over this file.
"""


def template(command: str, settings: Mapping[str, Setting]) -> str:
    """The file: all settings in their groups, each with its help, commented out."""
    lines = [HEAD.format(command=command)]
    groups: dict[Group, list[Setting]] = {}
    for setting in settings.values():
        groups.setdefault(setting.group, []).append(setting)
    for group, members in groups.items():
        about = f": {group.description}" if group.description else ""
        lines.append(f"# == {group.title}{about} ==\n")
        for setting in members:
            lines.append(f"# {setting.help[:1].upper()}{setting.help[1:]}.")
            lines.append(f"# {setting.name} = {_value(setting)}\n")
    return "\n".join(lines)


def _value(setting: Setting) -> str:
    """The default in TOML, or an example."""
    return EXAMPLES.get(setting.name) or toml_value(setting.name, setting.default)


class TemplateAction(argparse.Action):
    """Print the template and end, as ``--help`` does."""

    def __init__(self, option_strings: list[str], dest: str, const: tuple[str, Mapping[str, Setting]], **about: Any):
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, const=const, default=argparse.SUPPRESS, **about)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Print and end with exit code 0."""
        print(template(*self.const))
        parser.exit()
