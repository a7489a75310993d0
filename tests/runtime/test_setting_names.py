"""Settings in sentences: marked once, named as an option on the command line and as an argument in Python."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import torchsphere
from torchsphere.runtime.setting_names import as_arguments, as_options
from torchsphere.settings.limits import SettingError

PACKAGE = Path(torchsphere.__file__).parent

#: Packages whose sentences reach both readers. Those above them speak to the command line, the page or a report alone.
FOR_BOTH = (
    *("recording", "geometry", "imaging", "correlation", "sphere_map", "detection", "tracking", "estimation"),
    *("dynamics", "synthetic", "results", "diagnostics", "notebook", "settings"),
)


@pytest.mark.parametrize(
    ("marked", "arguments", "options"),
    [
        ("`mass_g` = -3: expected", "mass_g = -3: expected", "--mass-g -3: expected"),
        ("give `circle` X,Y,R", "give circle X,Y,R", "give --circle X,Y,R"),
        ("`window` = 4 with `order` = 3", "window = 4 with order = 3", "--window 4 with --order 3"),
        ("a sentence without any", "a sentence without any", "a sentence without any"),
    ],
)
def test_a_marked_name_is_an_argument_or_an_option(marked: str, arguments: str, options: str) -> None:
    assert as_arguments(marked) == arguments
    assert as_options(marked) == options
    assert (str(SettingError(marked)), SettingError(marked).as_options()) == (arguments, options)


def literals(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Lines and texts of the strings of a module, docstrings left out; the values in an f-string are "*"."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    left_out = {
        node.body[0].value for node in ast.walk(tree) if isinstance(node, documented) and ast.get_docstring(node)
    }
    # Attributes are documented by a string below them.
    left_out |= {node.value for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    parts = {part for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield node.lineno, "".join(str(v.value) if isinstance(v, ast.Constant) else "*" for v in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in left_out | parts:
            yield node.lineno, node.value


def test_sentences_that_reach_python_and_the_command_line_mark_settings_and_name_no_option() -> None:
    found = []
    for package in FOR_BOTH:
        for path in (PACKAGE / package).glob("*.py"):
            if path.name in ("suggestion.py", "setting.py", "html.py"):
                # These speak of what was written on the command line, or of what to write there.
                continue
            for line, text in literals(ast.parse(path.read_text(encoding="utf-8"))):
                # A command in quotation marks may have options of its own, for both readers.
                rest = re.sub(r"'torchsphere [^']*'", "", text)
                if re.search(r"(?<![\w-])--[a-z]", rest):
                    found.append(f"{path.relative_to(PACKAGE)}:{line}: {rest}")
    assert found == []
