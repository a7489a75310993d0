"""Settings from a file, from the cells of a row and from a command, each refused with its place."""

from pathlib import Path

import pytest

from torchsphere.request import SETTINGS
from torchsphere.settings.configuration import as_toml, find, from_cells, merged, of_command, read_config


def test_the_refusal_of_an_unknown_key_lists_the_settings() -> None:
    assert find(SETTINGS, "mm-per-px").name == "mm_per_px"
    with pytest.raises(ValueError, match=r"'speed' is no setting; expected one of axes, bayer, cfc, circle, .*window"):
        find(SETTINGS, "speed")
    with pytest.raises(ValueError, match="'no_report' is no setting; write report = false"):
        find(SETTINGS, "no_report")


def test_an_option_of_the_command_wins_over_the_file(tmp_path: Path) -> None:
    config = tmp_path / "shot.toml"
    config.write_text("fps = 36000\nmass_g = 20\nmm-per-px = 0.3\n")
    options = dict.fromkeys(SETTINGS) | {"config": config, "fps": 1000.0, "diameter_mm": 30.0}
    # A scale of either kind replaces that of the file.
    assert of_command(options, SETTINGS) == {"mass_g": 20.0, "fps": 1000.0, "diameter_mm": 30.0}
    assert of_command(options | {"config": None}, SETTINGS) == {"fps": 1000.0, "diameter_mm": 30.0}


def test_an_own_scale_replaces_a_common_one() -> None:
    assert merged({"mm_per_px": 0.3, "fps": 10.0}, {"diameter_mm": 30.0}) == {"fps": 10.0, "diameter_mm": 30.0}
    assert merged({"mm_per_px": 0.3}, {"fps": 10.0}) == {"mm_per_px": 0.3, "fps": 10.0}


def test_the_cells_of_a_row_are_read_by_their_columns_and_refused_with_their_place() -> None:
    assert from_cells("a.csv, row 2", {"fps": "10", "mass-g": "3.5"}, SETTINGS) == {"fps": 10.0, "mass_g": 3.5}
    with pytest.raises(ValueError, match=r"a\.csv, row 2, column 'fps': fps = 'fast': expected a finite number"):
        from_cells("a.csv, row 2", {"fps": "fast"}, SETTINGS)


def test_settings_written_as_toml_are_read_back(tmp_path: Path) -> None:
    values = {"fps": 36000.0, "circle": (80.4, 120.7, 50.0), "frames": (10, None), "refine": True, "bayer": "RGGB"}
    path = tmp_path / "shot.toml"
    path.write_text(as_toml(values, SETTINGS))
    assert read_config(path, SETTINGS) == values
    with pytest.raises(ValueError, match="cannot be written as TOML"):
        as_toml({"fps": 36000.0, "speed": 3}, SETTINGS)


def test_a_file_that_is_no_toml_is_refused_with_its_name(tmp_path: Path) -> None:
    path = tmp_path / "shot.toml"
    path.write_text("fps = \n")
    with pytest.raises(ValueError, match=r"shot\.toml: is no TOML file"):
        read_config(path, SETTINGS)
