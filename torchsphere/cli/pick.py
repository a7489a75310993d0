"""The command ``torchsphere pick``: prepare and measure a recording on a page in the browser."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torchsphere.cli.console import loading_libraries
from torchsphere.cli.options import add_command, add_quiet, add_settings
from torchsphere.request import SETTINGS, check_settings
from torchsphere.runtime import steps
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.configuration import of_command


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Look at a recording in the browser, draw circle and ignored regions, set the numbers, and measure it."
    parser = add_command(commands, "pick", run, text, "example:  torchsphere pick shot.cihx --diameter-mm 30")
    parser.description += (
        " The page is served on this machine alone, under an address with a token. It writes a TOML file that track "
        "and batch take by --config. Settings given below are those that the page begins with. Ctrl-C ends it."
    )
    parser.add_argument("input", type=Path, metavar="INPUT", help="file or folder of images")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for the result (INPUT-result, here)")
    parser.add_argument("--config-out", type=Path, metavar="FILE.toml", help="file for the settings (INPUT.toml, here)")
    parser.add_argument("--config", type=Path, metavar="FILE.toml", help="settings to begin with; options win")
    parser.add_argument("--port", type=_port, default=0, metavar="N", help="port of the address (a free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the address and open no browser")
    add_quiet(parser, "print the address and nothing else")
    add_settings(parser, SETTINGS)


def _port(text: str) -> int:
    if not text.isdecimal() or not 0 <= int(text) <= 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is no port; expected a number from 1 to 65535, or 0 for a free one")
    return int(text)


def run(options: dict[str, Any]) -> int:
    """Serve the page until Ctrl-C; raises ValueError or OSError for a recording or a port that cannot be used."""
    base = _settings(options)
    with loading_libraries():
        from torchsphere.pick.server import PickServer
        from torchsphere.pick.session import Places, Session
        from torchsphere.recording import open_recording
    source, quiet = options["input"], options["quiet"]
    name = _name(source)
    places = Places(source, options["out"] or Path(f"{name}-result"), options["config_out"] or Path(f"{name}.toml"))
    shown_as = {name: base.get(name) for name in ("axes", "pixel_aspect", "bayer")}
    with open_recording(source, **shown_as) as recording:
        session = Session(recording, places, base)
        # A recording whose frames cannot be read is refused here, and not on the page.
        steps.tell("reading some frames of %s", source)
        _ = session.footage.levels
        with PickServer(session, options["port"]) as server:
            print(server.address if quiet else f"page    {server.address}", flush=True)
            if not quiet:
                print("Ctrl-C ends it.", flush=True)
            if not options["no_browser"] and _has_screen():
                webbrowser.open(server.address)
            try:
                # Ctrl-C is the way to end it.
                with contextlib.suppress(KeyboardInterrupt):
                    server.serve_forever()
            finally:
                session.close()
                if not quiet:
                    print("\nended", file=sys.stderr)
    return 0


def _settings(options: Mapping[str, Any]) -> dict[str, Any]:
    """The settings that the page begins with; raises ValueError where they contradict each other."""
    settings = of_command(options, SETTINGS)
    check_settings(settings)
    return settings


def _name(source: Path) -> str:
    """Name of the recording without its suffix, for the files that are written."""
    from torchsphere.recording.member import flat_name

    place = source if source.name not in ("", "..") else source.resolve()
    return shown(place.name if place.is_dir() else flat_name(place)) or "recording"


def _has_screen() -> bool:
    """Whether a browser has a screen to appear on; without one, a browser in text would take over the terminal."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
