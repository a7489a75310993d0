"""Images that a user gives: what is no stack of grey levels is refused with what to write instead."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import torchsphere as ts
from torchsphere.settings.arrays import as_stack

GREY = np.arange(8 * 20 * 30, dtype=np.float32).reshape(8, 20, 30)


@pytest.mark.parametrize("path", ["shot.tif", Path("shot.tif"), b"shot.tif"])
def test_a_path_is_refused_with_the_function_that_opens_it(path: Any) -> None:
    with pytest.raises(ValueError, match=r"recording = torchsphere\.open_recording\('shot\.tif'\)$"):
        ts.track(path)
    with pytest.raises(ValueError, match=r"f = torchsphere\.open_recording\('shot\.tif'\)\.images\(0, 1\)$"):
        ts.correlate(path, path, (64, 64, 20))


def test_names_of_images_are_refused_with_the_folder_that_can_be_opened() -> None:
    with pytest.raises(ValueError, match=r"names of files; put these into a folder and open it with torchsphere\.open"):
        ts.track(["a.png", "b.png"])


@pytest.mark.parametrize("kind", [np.asarray, torch.as_tensor])
@pytest.mark.parametrize(
    "images",
    [
        np.stack([GREY] * 3, -1),
        np.stack([GREY, GREY, GREY, np.full_like(GREY, 255)], -1),
        np.stack([GREY] * 3, 1),
        np.stack([GREY[0]] * 3, -1),
        GREY[..., None],
        GREY[:, None],
    ],
    ids=["colour last", "with transparency", "colour first", "one image in colour", "one channel", "one channel first"],
)
def test_each_way_to_grey_levels_that_a_refusal_of_colour_names_gives_them(images: Any, kind: Any) -> None:
    with pytest.raises(ValueError, match=r"got shape \(.*\)[,;] ") as refused:
        as_stack(kind(images), "images")
    ways = re.findall(r"images\[[^]]*\](?:\.mean\(-?1\))?", str(refused.value))
    assert ways
    for way in ways:
        found = as_stack(eval(way, {"images": kind(images)}), "images")
        assert np.array_equal(found, GREY[: len(found)])


def test_a_stack_of_narrow_images_is_no_colour() -> None:
    assert as_stack(np.zeros((8, 20, 7), np.uint8)).shape == (8, 20, 7)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"fps": -1}, "fps = -1: expected"),
        ({"mass_g": -3}, "mass_g = -3: expected"),
        ({"mass_kg": -3}, "mass_kg = -3: expected"),
        ({"diameter_mm": 0}, "diameter_mm = 0: expected"),
        ({"circle": (5, 5, 1)}, "circle = 5,5,1: expected a radius of 3 px or more"),
        ({"device": "tpu"}, "device = tpu: "),
    ],
)
def test_a_refusal_in_python_names_the_argument_with_the_value_that_was_given(
    options: dict[str, Any], said: str
) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(said)}") as refused:
        ts.track(GREY, **options)
    assert "--" not in str(refused.value)
    assert "`" not in str(refused.value)
