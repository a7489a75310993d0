"""A page of a report that a browser has opened."""

import csv
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

#: Frames of the demo's shot in the results that the browser opens.
FIRST, LAST = 34, 45


@dataclass
class Opened:
    """A page, its result, its requests and its messages on the console."""

    page: Any
    folder: Path
    requests: list[str] = field(default_factory=list)
    console_messages: list[str] = field(default_factory=list)

    def table(self, name: str) -> list[dict[str, str]]:
        with (self.folder / name).open(newline="") as stream:
            return list(csv.DictReader(stream))

    def at(self) -> int:
        return int(self.page.evaluate("torchsphere.state.stop"))

    def drawn(self, canvas: str) -> dict[str, Any]:
        return json.loads(self.page.get_attribute(canvas, "data-drawn"))

    def text(self, value: str) -> float:
        """A number of the page."""
        return float(self.page.text_content(f'[data-value="{value}"]').replace("\u2212", "-"))
