"""The template of a file of settings."""

import re
import tomllib

import pytest

from torchsphere.cli.main import main
from torchsphere.cli.options import EXAMPLES, template
from torchsphere.request import PER_RECORDING, SETTINGS
from torchsphere.settings.configuration import from_table


@pytest.mark.parametrize(("command", "settings"), [("track", SETTINGS), ("batch", PER_RECORDING)])
def test_the_template_has_every_setting_as_a_line_that_is_valid_once_its_sign_is_taken_away(
    command: str, settings: dict, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main([command, "--config-template"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    assert tomllib.loads(text) == {}
    values = tomllib.loads("\n".join(re.findall(r"^# (\w+ = .+)$", text, re.MULTILINE)))
    assert list(values) == list(settings)
    found = from_table("template", values, settings)
    for name, setting in settings.items():
        if name not in EXAMPLES:
            assert found[name] == setting.default or tuple(found[name]) == setting.default


def test_every_setting_without_a_default_has_an_example() -> None:
    assert {name for name, setting in SETTINGS.items() if setting.default is None} <= set(EXAMPLES)
    assert "null" not in template("track", SETTINGS)
