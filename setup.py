"""The description on the package index: the README without pictures, and without links that need a copy of the project.

All else about the package stands in pyproject.toml.
"""

import re
from pathlib import Path

from setuptools import setup

NOTE = "\nThe files that are named here are in the source distribution.\n"


def description(readme: str) -> str:
    """Return the README with relative links as plain text and without pictures."""
    without_pictures = re.sub(r"^!\[.*\]\(.*\)\n\n", "", readme, flags=re.MULTILINE)
    return re.sub(r"\[([^\]]+)\]\((?!https?:)[^)]+\)", r"\1", without_pictures) + NOTE


readme = Path(__file__).with_name("README.md").read_text(encoding="utf-8")
setup(long_description=description(readme), long_description_content_type="text/markdown")
