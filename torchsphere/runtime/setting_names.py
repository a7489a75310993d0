"""Names of settings in sentences: arguments in Python, options on the command line.

A sentence of the program marks the name of a setting with backticks: "give `circle` X,Y,R", "`fps` = 3: expected ...".
It is written once. Python shows it as it is, in refusals without the backticks; the command line and the files of a
result name the options.
"""

from __future__ import annotations

import re


def option_name(name: str) -> str:
    """The name of a setting on the command line."""
    return f"--{name.replace('_', '-')}"


def as_arguments(sentence: str) -> str:
    """The sentence with bare names: "give circle X,Y,R", "fps = 3: expected ..."."""
    return sentence.replace("`", "")


def as_options(sentence: str) -> str:
    """The sentence for the command line: "give --circle X,Y,R", "--fps 3: expected ..."."""
    return re.sub(r"`([a-z]\w*)`(?: =)?", lambda match: option_name(match[1]), sentence)
