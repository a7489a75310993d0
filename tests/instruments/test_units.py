"""Units as loggers write them."""

import pytest

from torchsphere.instruments.units import ACCELERATION, STRAIN, TIME, are_units, converted, in_brackets, is_unit


@pytest.mark.parametrize(
    ("quantity", "unit", "texts"),
    [
        (TIME, "s", ("s", "S", "sec", "Second", "seconds")),
        (TIME, "us", ("us", "µs", "μs", "usec")),
        (ACCELERATION, "m/s^2", ("m/s^2", "m/s²", "m/s2", "m/s**2", "m s^-2", "m·s⁻²", "m/s/s", "m_s2", "m / s²")),
        (ACCELERATION, "mm/s^2", ("mm/s²", "mm/s^2")),
        (ACCELERATION, "g", ("g", "G", "gn")),
        (STRAIN, "microstrain", ("µm/m", "um/m", "με", "ustrain", "microstrain")),
        (STRAIN, "strain", ("m/m", "mm/mm", "ε", "strain")),
        (STRAIN, "percent", ("%", "percent")),
    ],
)
def test_a_unit_is_known_in_all_its_ways_of_writing(quantity, unit: str, texts: tuple[str, ...]) -> None:
    for text in texts:
        assert quantity.unit(text) == unit
        for name in (f"signal [{text}]", f"signal ({text})"):
            assert quantity.stated(name, in_brackets(name)) == unit
        assert quantity.stated(f"signal / {text}", "") == unit
        assert is_unit(text)
    assert quantity.stated("signal", "") is None


@pytest.mark.parametrize("name", ["near", "far", "Channel A", "CH1", "time", "strain rate", "1"])
def test_a_name_is_no_unit(name: str) -> None:
    assert not is_unit(name)


@pytest.mark.parametrize(
    ("texts", "are"),
    [
        (["s", "furlong"], True),
        (["-", "(ms)", "°C"], True),
        (["V", "mV"], True),
        (["t", "s", "F"], False),
        (["Versuch", "3"], False),
        ([], False),
    ],
)
def test_a_line_is_one_of_units_if_all_are_known_or_its_first_word_is_one_of_time(texts: list[str], are: bool) -> None:
    assert are_units(texts) == are


def test_a_given_unit_or_number_wins_and_a_contradiction_is_said() -> None:
    assert converted(ACCELERATION, "a [g]", "g", None) == (9.80665, "g, as the file states", ())
    assert converted(ACCELERATION, "a", "", "g") == (9.80665, "g, as given", ())
    assert converted(ACCELERATION, "a", "", "98.0665") == (98.0665, "98.0665 m/s^2, as given", ())
    # The same unit, written otherwise.
    assert converted(ACCELERATION, "a [m/s²]", "m/s²", "m/s^2")[2] == ()
    factor, _, (warning,) = converted(ACCELERATION, "a [g]", "g", "m/s^2")
    assert factor == 1.0
    assert "'a [g]' is in g by the file" in warning
    factor, said, (warning,) = converted(STRAIN, "e [mV/V]", "mV/V", None)
    assert (factor, said) == (1.0, "strain, as nothing states another")
    assert "the number of strain in one mV/V" in warning
    for text in ("percent", "-1", "nan", "0"):
        with pytest.raises(ValueError, match=text):
            ACCELERATION.factor(text)
