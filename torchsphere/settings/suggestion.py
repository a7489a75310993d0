"""What was probably meant by a name of a setting or an option that is not known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

#: Least likeness of two words, 0 to 1, of which one may be meant by the other.
LIKENESS = 0.6

#: Words of other programs for an option.
OTHER_NAMES = {
    "--frame-rate": "--fps",
    "--framerate": "--fps",
    "--rate": "--fps",
    "--exposure": "--shutter-us",
    "--mask": "--ignore",
    "--scale": "--mm-per-px",
    "--radius": "--circle",
    "--center": "--circle",
    "--output": "--out",
    "--start": "--frames",
    "--end": "--frames",
    "--force": "--overwrite",
    "--gpu": "--device",
}


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """A question with the likeliest of the names, to end a refusal with; empty where none is alike."""
    known = sorted(set(names))
    word = word.partition("=")[0]
    longer = [name for name in known if name.startswith(word) and len(word) > 3]
    found = longer or difflib.get_close_matches(word, known, n=1, cutoff=LIKENESS)
    if OTHER_NAMES.get(word) in known:
        found = [OTHER_NAMES[word]]
    return f"; did you mean {' or '.join(found[:3])}?" if found else ""
