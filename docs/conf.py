"""How Sphinx builds these pages: ``make docs``. Nothing is fetched, neither then nor by whoever reads them."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent / "_ext"), str(Path(__file__).parent.parent)]

from sphinx.domains.python import PyObject  # noqa: E402

from torchsphere import __version__  # noqa: E402  (found only now)

project = "torchsphere"
author = "The torchsphere developers"
project_copyright = author
version = release = __version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "myst_parser",
    "mathml",
    "command_line",
    "fields",
    "constants",
]
exclude_patterns = ["_build", "tables"]  # pages include the tables

myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_typehints = "none"  # the docstrings say types and shapes
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
default_role = "py:obj"
add_module_names = False

# Quotes are meant as they stand: they belong to commands. Options are code, where dashes stay what they are.
smartquotes_action = "D"

# Fields of the dataclasses, which the docstrings and the code call attributes, too.
for field in PyObject.doc_field_types:
    if field.name == "variable":
        field.label = "Attributes"

html_theme = "furo"
html_title = "torchsphere"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_show_sphinx = False
html_show_copyright = False
html_show_sourcelink = False
html_copy_source = False
