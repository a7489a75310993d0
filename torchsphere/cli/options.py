"""Options of the command line from descriptions of settings, and options of several commands.

The descriptions themselves stand where the settings are taken: `request` for a measurement, `plan_request` and
`instrument_request` for the other commands.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from torchsphere.cli.config_template import TemplateAction
from torchsphere.settings.limits import SettingError
from torchsphere.settings.setting import SWITCH, Group, Setting


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
