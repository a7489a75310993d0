"""Errors as one sentence on a page, with settings by the labels of its form."""

from __future__ import annotations

import re

from torchsphere.pick.form import FIELDS
from torchsphere.runtime.setting_names import as_options
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.limits import SettingError

#: What stands for an option of the command line in a sentence of the measurement.
ON_PAGE = {
    "--overwrite to replace it": "tick 'Replace earlier files'",
    "give --circle X,Y,R of the ball": "draw the circle of the ball",
    "give --circle X,Y,R if it is wrong": "draw the right one if it is wrong",
    "give its outline with --circle as x, y, radius in px of the first frame to track": "draw its outline as a circle",
    "give that with --circle as x, y, radius in px of the first frame to track": "draw that as a circle",
    ", or track with the circle as given": " (drag it by its middle and by its rim)",
}


def sentence_of(error: Exception) -> str:
    """The error in one sentence that begins with a capital."""
    if isinstance(error, OSError) and error.strerror is not None:
        text = f"{error.filename or 'file'}: {error.strerror.lower()}; check the name and the permissions"
    else:
        said = error.marked if isinstance(error, SettingError) else str(error)
        text = " ".join(said.split())
    text = shown(on_page(text))
    # A sentence may begin with the name of a file or of a setting, which stays as it is.
    return text[:1].upper() + text[1:] if re.match(r"[a-z]+ ", text) else text


def on_page(sentence: str) -> str:
    """A sentence of the measurement with the words of the page for options of the command line."""
    for name, field in FIELDS.items():
        sentence = sentence.replace(f"`{name}`", field.label)
    sentence = as_options(sentence)
    for option, place in ON_PAGE.items():
        sentence = sentence.replace(option, place)
    for name, pattern in _NAMES.items():
        sentence = pattern.sub(FIELDS[name].label, sentence)
    return sentence


def fields_of(error: Exception) -> list[str]:
    """Names of the form's fields that the error is about."""
    return [name for name, pattern in _NAMES.items() if pattern.search(str(error))]


#: How sentences name the fields of the form: as settings, and as options of the command line.
_NAMES = {name: re.compile(rf"(?<![\w-])(?:--{name.replace('_', '-')}|{name})(?![\w-])") for name in FIELDS}
