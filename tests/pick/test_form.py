"""Settings between the page and a TOML file."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchsphere.pick import form
from torchsphere.pick.form import Choice, settings_of, toml_text
from torchsphere.request import PER_RECORDING, SETTINGS
from torchsphere.settings.configuration import read_config

SHAPE = (8, 192, 384)
NUMBERS = {"fps": "36000", "diameter_mm": "30", "mass_g": "110"}


def choice(**sent: Any) -> Choice:
    # What a browser sends has been JSON.
    return Choice.of(json.loads(json.dumps(sent)), SHAPE[0])


def test_an_untouched_page_asks_for_nothing() -> None:
    assert settings_of(choice(fields=dict.fromkeys(NUMBERS, "")), {}, SHAPE) == {}


def test_what_is_drawn_and_written_becomes_settings() -> None:
    drawn = {"x": 64.30049, "y": 92.6, "radius": 40, "frame": 2}
    fields = {
        **NUMBERS,
        "telecentric": True,
        "in_place": False,
        "distortion": "0.1, 0, 0",
        "focal_px": "",
        "fps": " 36000 ",
    }
    fields.pop("distortion")
    sent = choice(fields=fields, circle=drawn, frames=[2, 6], ignore=["1,1 9,1 9,9"])
    assert settings_of(sent, {}, SHAPE) == {
        "fps": 36000.0,
        "diameter_mm": 30.0,
        "mass_g": 110.0,
        "telecentric": True,
        "frames": (2, 7),
        "circle": (64.3, 92.6, 40.0),
        "ignore": ["1,1 9,1 9,9"],
    }


def test_settings_without_a_place_on_the_page_stay_and_all_others_are_those_of_the_page() -> None:
    base = {"map": "off", "roi": 0.8, "fps": 10.0, "circle": (1.0, 2.0, 30.0), "frames": (1, 4), "telecentric": True}
    found = settings_of(choice(fields={"fps": "20", "telecentric": False}), base, SHAPE)
    assert found == {"map": "off", "roi": 0.8, "fps": 20.0}


@pytest.mark.parametrize(
    ("sent", "sentence"),
    [
        ({"fields": {"mass_g": "-3", "diameter_mm": "30"}}, "mass_g = -3: expected a finite, positive number"),
        ({"fields": {"fps": "36,5"}}, "fps = '36,5': expected a finite number; the decimal sign is a point"),
        ({"fields": {"mass_g": "110"}}, "mass_g was given without a scale"),
        ({"fields": {"diameter_mm": "30", "mm_per_px": "0.3"}}, "were both given; the scale needs one of them"),
        ({"fields": {"diameter_mm": "30", "distance_mm": "10"}}, "distance_mm = 10: lies within the ball"),
        ({"fields": {"input": "x"}}, "'input' is no field of the page"),
        ({"frames": [3, 3]}, "frames from 3 to 3: expected a first frame of 0 or more, and a later last frame of 7"),
        ({"frames": [0, 8]}, "frames from 0 to 8"),
        ({"circle": {"x": 9, "y": 9, "radius": 5, "frame": 3}}, "circle lies in frame 3, and frame 0 is the first"),
        ({"ignore": ["1,1 2,2"]}, "a polygon needs three or more corners"),
        ({"ignore": ["-1,-1 400,-1 400,200 -1,200"]}, "leaves nothing of the recording's images"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_one_sentence(sent: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=r"^[^\n]*$") as refused:
        settings_of(choice(**sent), {}, SHAPE)
    assert sentence in str(refused.value)


@pytest.mark.parametrize("sent", [{"circle": [1, 2, 3]}, {"frames": "all"}, {"frames": [0, 1e400]}, {"fields": 3}])
def test_a_request_that_no_page_sends_is_refused_in_one_sentence(sent: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="the page sent settings that cannot be read"):
        Choice.of(sent, 8)


def read_back(path: Path, text: str) -> dict[str, Any]:
    path.write_text(text, encoding="utf-8")
    read = read_config(path, SETTINGS)
    # `batch --config` takes the settings that may differ between recordings.
    assert read == read_config(path, PER_RECORDING)
    return {name: tuple(value) if isinstance(value, list) else value for name, value in read.items()}


POSITIVE = st.floats(1e-5, 1e9)
ANY = {
    "fps": POSITIVE,
    "diameter_mm": POSITIVE,
    "mass_sd_percent": st.floats(0, 99.9),
    "circle": st.tuples(POSITIVE, POSITIVE, POSITIVE),
    "frames": st.tuples(st.none() | st.integers(0, 9), st.none() | st.integers(10, 10**6)),
    "ignore": st.lists(st.text(min_size=1), min_size=1).map(tuple),
    "principal_px": st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    "telecentric": st.booleans(),
    "report": st.booleans(),
    "map": st.sampled_from(["auto", "on", "off"]),
    "window": st.integers(3, 99),
    "normal_deg": st.floats(-360, 360),
}


@settings(max_examples=25, deadline=None)
@given(st.fixed_dictionaries({}, optional=ANY), st.text())
def test_the_file_gives_back_all_settings_whatever_the_recording_is_called(
    tmp_path_factory: pytest.TempPathFactory, given_settings: dict[str, Any], name: str
) -> None:
    text = toml_text(given_settings, name)
    assert read_back(tmp_path_factory.getbasetemp() / "any.toml", text) == given_settings


def test_the_file_leaves_out_what_holds_for_one_run() -> None:
    assert "overwrite" not in toml_text({"overwrite": True, "fps": 5.0}, "shot.tif")


def test_an_earlier_file_is_replaced_only_where_it_may_be(tmp_path: Path) -> None:
    path = tmp_path / "shot.toml"
    form.write_toml(path, "fps = 1\n", replace=False)
    with pytest.raises(FileExistsError, match="tick 'Replace earlier files'"):
        form.write_toml(path, "fps = 2\n", replace=False)
    assert path.read_text() == "fps = 1\n"
    form.write_toml(path, "fps = 2\n", replace=True)
    assert path.read_text() == "fps = 2\n"
    assert [entry.name for entry in tmp_path.iterdir()] == ["shot.toml"]


def test_every_field_of_the_form_is_a_setting_and_its_text_is_read_back() -> None:
    for name, field in form.FIELDS.items():
        assert field.is_switch or SETTINGS[name].from_text(form.text_of(name, (1.5, 2, 3)[: _count(name)] or 1.5))
    assert form.text_of("distortion", (0.1, 0.0, -2.5)) == "0.1, 0, -2.5"


def _count(name: str) -> int:
    return {"principal_px": 2, "distortion": 3}.get(name, 0)
