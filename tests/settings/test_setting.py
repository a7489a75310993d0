"""Descriptions of settings, from which text, TOML and options are read and refused."""

import argparse
import dataclasses
import re
from pathlib import Path

import pytest

from torchsphere.cli.options import add_settings
from torchsphere.instruments.instrument_request import INSTRUMENT_SETTINGS, InstrumentRequest
from torchsphere.planning.plan_request import PLAN_SETTINGS, PlanRequest
from torchsphere.request import PER_RECORDING, SETTINGS, Request
from torchsphere.settings.configuration import given_settings, read_config

#: A value of each kind as text, as TOML, and as the setting takes it.
VALUES = {
    "fps": ("36000", 36000, 36000.0),
    "window": ("9", 9, 9),
    "pixel_aspect": ("11:10", 1.1, 1.1),
    "bayer": ("RGGB", "RGGB", "RGGB"),
    "in_place": ("yes", True, True),
    "circle": ("80.4 120.7 50", [80.4, 120.7, 50], (80.4, 120.7, 50.0)),
    "frames": ("10:90", "10:90", (10, 90)),
    "axes": ("hwn", "hwn", "hwn"),
    "model": ("finite", "finite", "finite"),
    "ignore": ("mask.png", ["mask.png"], ["mask.png"]),
}


def test_every_field_but_input_and_output_is_described() -> None:
    fields = {field.name for field in dataclasses.fields(Request)}
    assert set(SETTINGS) == fields - {"input", "out"}
    assert set(PER_RECORDING) == set(SETTINGS) - {"overwrite"}
    assert set(PLAN_SETTINGS) == {field.name for field in dataclasses.fields(PlanRequest)}
    assert set(INSTRUMENT_SETTINGS) == {field.name for field in dataclasses.fields(InstrumentRequest)}
    assert all(setting.help for setting in (SETTINGS | PLAN_SETTINGS | INSTRUMENT_SETTINGS).values())


@pytest.mark.parametrize("name", VALUES)
def test_text_toml_and_option_give_the_same_value(name: str, tmp_path: Path) -> None:
    text, toml, expected = VALUES[name]
    setting = SETTINGS[name]
    assert setting.from_text(f" {text} ") == expected
    assert setting.from_toml(toml) == expected
    parser = argparse.ArgumentParser()
    add_settings(parser, SETTINGS)
    typed = [setting.option] if expected is True else [setting.option, text]
    assert given_settings(vars(parser.parse_args(typed)), SETTINGS) == {name: expected}
    config = tmp_path / "shot.toml"
    config.write_text(f"{name.replace('_', '-')} = {str(toml).lower() if toml is True else repr(toml)}\n")
    assert read_config(config, SETTINGS) == {name: expected}


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("fps", "36000", "fps = '36000': expected a finite number; write fps = a number, without quotation marks"),
        ("fps", True, "fps = True: expected a finite number"),
        ("fps", float("nan"), "fps = nan: expected a finite number"),
        (
            "pixel_aspect",
            "1:0",
            "pixel_aspect = '1:0': expected a ratio such as 11:10, or a number; write pixel_aspect = ",
        ),
        ("pixel_aspect", True, "pixel_aspect = True: expected a ratio"),
        ("bayer", "rggb", "bayer = 'rggb': expected one of RGGB, BGGR, GRBG, GBRG"),
        ("window", 7.5, "window = 7.5: expected a whole number"),
        ("in_place", 1, "in_place = 1: expected true or false"),
        ("circle", [1, 2], "circle = [1, 2]: expected three numbers X,Y,R; write circle = [X, Y, R]"),
        ("circle", ["a", 2, 3], "circle = ['a', 2, 3]: expected three numbers"),
        ("frames", "all", "frames = 'all': expected frames A:B; write frames = \"A:B\""),
        ("model", "wobbly", "model = 'wobbly': expected one of translation, published,"),
        ("ignore", [3], "ignore = [3]: expected a mask image or a polygon"),
    ],
)
def test_the_refusal_of_a_toml_value_states_a_valid_form(name: str, value: object, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        SETTINGS[name].from_toml(value)


def test_a_ratio_may_be_written_in_several_ways() -> None:
    setting = SETTINGS["pixel_aspect"]
    assert [setting.from_text(text) for text in ("5:4", "5/4", "1.25", " 5 : 4 ")] == 4 * [1.25]
    assert setting.from_toml("5:4") == setting.from_toml(1.25) == 1.25
    for aspect in (0.1, 9.0, -1.0):
        with pytest.raises(ValueError, match=r"expected a number from 0\.25 to 4"):
            Request(input=Path("a"), out=Path("b"), pixel_aspect=aspect)
