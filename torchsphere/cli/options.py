"""Options of the command line from descriptions of settings, and options of several commands.

The descriptions themselves stand where the settings are taken: `request` for a measurement, `plan_request` and
`instrument_request` for the other commands.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from torchsphere.settings.configuration import toml_value
from torchsphere.settings.limits import SettingError
from torchsphere.settings.setting import SWITCH, Group, Setting

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


def add_command(commands: Any, name: str, run: Callable[[dict[str, Any]], int], help_text: str, epilog: str) -> Any:
    """Add a command with the function ``run`` of its options, and return its parser."""
    parser = commands.add_parser(name, help=help_text, description=help_text, epilog=epilog, allow_abbrev=False)
    parser.set_defaults(run=run)
    return parser


def add_settings(parser: argparse.ArgumentParser, settings: Mapping[str, Setting]) -> None:
    """Add an option for each setting, in groups; an option that is not given is None."""
    groups: dict[Group, Any] = {}
    for setting in settings.values():
        if setting.group not in groups:
            groups[setting.group] = parser.add_argument_group(setting.group.title, setting.group.description)
        _add_setting(groups[setting.group], setting)


def _add_setting(group: Any, setting: Setting) -> None:
    about: dict[str, Any] = {"dest": setting.name, "default": None, "help": setting.help_text.replace("%", "%%")}
    if setting.kind is SWITCH:
        group.add_argument(setting.option, action="store_false" if setting.default is True else "store_true", **about)
        return
    metavar = setting.metavar or f"{{{','.join(setting.kind.names)}}}"
    action = "extend" if setting.repeats else "store"
    group.add_argument(setting.option, action=action, type=_reader(setting), metavar=metavar, **about)


def _reader(setting: Setting) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        try:
            return setting.from_text(text)
        except SettingError as error:
            # argparse adds the name of the option.
            raise argparse.ArgumentTypeError(str(error).partition(" = ")[2]) from error

    return read


def add_quiet(parser: argparse.ArgumentParser, help_text: str = "no progress bar, no summary") -> None:
    """Add ``--quiet``."""
    parser.add_argument("--quiet", action="store_true", help=help_text)


def add_config(parser: argparse.ArgumentParser, command: str, settings: Mapping[str, Setting], help_text: str) -> None:
    """Add ``--config`` and ``--config-template``."""
    parser.add_argument("--config", type=Path, metavar="FILE.toml", help=help_text)
    parser.add_argument(
        "--config-template",
        action=TemplateAction,
        const=(command, settings),
        help="print such a file with every setting, and end",
    )


def add_verbose(parser: argparse.ArgumentParser) -> None:
    """Add ``--verbose``."""
    parser.add_argument("--verbose", action="store_true", help="say on the standard error what is done, and when")


def add_out(parser: argparse.ArgumentParser, help_text: str = "folder for the result") -> None:
    """Add ``--out``."""
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help=help_text)


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
