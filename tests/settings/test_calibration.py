"""What is known of camera and ball: given over carried, contradictions, names of the command line, and units."""

import pytest

from torchsphere.request import SETTINGS
from torchsphere.settings.calibration import OPTION_NAMES, Calibration, implausible_units, with_option_names


def test_what_is_given_wins_and_a_contradiction_is_a_sentence() -> None:
    known = Calibration(frame_rate=36_000.0, diameter_m=0.03, mass_kg=0.11)
    same, silent = known.overridden(Calibration(frame_rate=36_000.0), "The track")
    assert (same, silent) == (known, ())
    other, notes = known.overridden(Calibration(frame_rate=30_000.0, mass_kg=0.2), "The file")
    assert other == Calibration(30_000.0, 0.03, None, 0.2)
    assert notes == (
        "The file states frame_rate = 36000; 30000 was given and used.",
        "The file states mass_kg = 0.11; 0.2 was given and used.",
    )


def test_a_scale_of_the_other_kind_takes_the_place_of_the_known_one() -> None:
    found, notes = Calibration(diameter_m=0.03).overridden(Calibration(m_per_px=4e-4), "The track")
    assert found == Calibration(m_per_px=4e-4)
    assert notes == ("The track states diameter_m = 0.03; m_per_px = 0.0004 was given and used.",)


@pytest.mark.parametrize("wrong", [{"frame_rate": 0.0}, {"mass_kg": float("nan")}, {"diameter_m": "3 cm"}])
def test_a_number_that_none_can_have_is_refused_by_its_name(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Calibration(**wrong)


def test_names_of_the_command_line_are_taken_in_its_units() -> None:
    found = with_option_names("f", {"diameter_m": None, "mass_kg": None}, {"diameter_mm": 30, "mass_g": 110.0})
    assert found == {"diameter_m": pytest.approx(0.03), "mass_kg": pytest.approx(0.11)}
    with pytest.raises(ValueError, match="diameter_m and diameter_mm were both given"):
        with_option_names("f", {"diameter_m": 0.03}, {"diameter_mm": 30})
    with pytest.raises(TypeError, match="f has no argument 'mass_g': these are diameter_m, diameter_mm"):
        with_option_names("f", {"diameter_m": None}, {"mass_g": 1.0})
    with pytest.raises(ValueError, match="mass_g = 'heavy': expected a finite number"):
        with_option_names("f", {"mass_kg": None}, {"mass_g": "heavy"})


def test_each_name_of_the_command_line_is_one_of_its_settings() -> None:
    assert set(OPTION_NAMES) <= set(SETTINGS)


def test_a_diameter_or_mass_in_another_unit_is_told() -> None:
    assert implausible_units(0.03, 0.11) == ()
    assert "30 m, which is implausible; check the units: diameter_m is in m" in implausible_units(30.0, None)[0]
    assert "kg/m3 and is implausible" in implausible_units(0.03, 110.0)[0]


def test_a_standard_deviation_belongs_to_its_quantity() -> None:
    known = Calibration(36_000.0, 0.03, None, 0.11, 0.01, 0.02, 0.03)
    assert known.overridden(Calibration(), "The track")[0] == known
    assert known.overridden(Calibration(diameter_m=0.03), "The track")[0] == known
    assert known.overridden(Calibration(relative_sd_scale=0.05), "The track")[0].relative_sd_scale == 0.05
    other, _ = known.overridden(Calibration(m_per_px=4e-4, mass_kg=0.2, relative_sd_mass=0.001), "The track")
    assert other == Calibration(36_000.0, None, 4e-4, 0.2, 0.01, 0.0, 0.001)


def test_options_of_the_command_line_come_back() -> None:
    options = {"fps": 36_000.0, "diameter_mm": 30.1, "mass_g": 110.3, "scale_sd_percent": 0.7, "fps_sd_percent": 0.001}
    known = Calibration.of_options(options | {"shell_mm": 2.0, "model": "rigid", "mass_sd_percent": 0.0}, 1000.0)
    assert known.diameter_m == pytest.approx(0.0301, rel=1e-12)
    assert (known.m_per_px, known.relative_sd_mass) == (None, 0.0)
    assert known.options() == options
    assert Calibration.of_options({}, 1000.0) == Calibration(1000.0)
