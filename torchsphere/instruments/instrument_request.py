"""The settings of ``torchsphere instruments``: the file of the instrument, the gate, the sensor, and the bar."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from torchsphere.instruments.units import ACCELERATION, STRAIN, TIME, Quantity
from torchsphere.settings.limits import SettingError, require_finite, shown_value
from torchsphere.settings.setting import (
    NUMBER,
    PATH,
    Group,
    Kind,
    Setting,
    check_ranges,
    finite,
    one_of,
    percent,
    positive,
    settings_of,
    switch,
)

FILE = Group("the instrument, one of three, and its file")
COMPARISON = Group("the comparison")
BAR = Group("the bar with the strain gauge")

TEXT = Kind(str, "a text", '"...", in quotation marks', (str,))


def _require_magnitude(name: str, value: float) -> None:
    require_finite(name, value)
    if value < 0:
        raise SettingError(f"`{name}` = {value:g}: expected a number, 0 or more")


def _magnitude(group: Group, metavar: str, text: str) -> Setting:
    return Setting(NUMBER, group, metavar, text, _require_magnitude)


@dataclass(frozen=True, kw_only=True)
class InstrumentRequest:
    """What to compare a track with; each field is a setting that its `Setting` describes.

    Raises
    ------
    SettingError
        Where a setting is out of its range, is missing, or belongs to another instrument.
    """

    gate: Annotated[Path | None, Setting(PATH, FILE, "FILE", "signals of two barriers, in the order of passage")] = None
    accelerometer: Annotated[Path | None, Setting(PATH, FILE, "FILE", "an accelerometer's signal")] = None
    strain_gauge: Annotated[Path | None, Setting(PATH, FILE, "FILE", "strain of a long bar that the ball hits")] = None
    columns: Annotated[
        str | None,
        Setting(
            TEXT,
            FILE,
            "NAME[,NAME]",
            "columns of the signals (the first after the times); of several strain gauges the mean is taken",
        ),
    ] = None
    unit: Annotated[
        str | None,
        Setting(
            TEXT,
            FILE,
            "UNIT",
            f"of the signal: {', '.join(ACCELERATION.factors)}; {', '.join(STRAIN.factors)}; or its size in m/s^2 or "
            "in strain (as the file states, or else m/s^2 or strain)",
        ),
    ] = None
    time_column: Annotated[
        str | None, Setting(TEXT, FILE, "NAME", "column of the times (whose name or unit says so, or the first)")
    ] = None
    time_unit: Annotated[
        str | None,
        one_of(tuple(TIME.factors), FILE, "unit of the times (as the file states, or else s)"),
    ] = None
    sampling_hz: Annotated[float | None, positive(FILE, "F", "samples per second, in place of the file's times")] = None
    spacing_mm: Annotated[float | None, positive(COMPARISON, "L", "distance of the barriers; --gate needs it")] = None
    sd_spacing_mm: Annotated[float, _magnitude(COMPARISON, "SD", "its standard deviation")] = 0.0
    direction_deg: Annotated[
        float | None,
        finite(
            COMPARISON,
            "A",
            "direction in which the accelerometer measures (0), across the gate from its first barrier (along the "
            "ball's path), or from the bar to the ball (the impact's normal), from x towards y of the result's frame",
        ),
    ] = None
    plot: Annotated[
        Path | None, Setting(PATH, COMPARISON, "PNG", "draw the accelerometer, or the bar's force, over the track")
    ] = None
    bar_diameter_mm: Annotated[float | None, positive(BAR, "D", "diameter of a round, solid bar, mm")] = None
    bar_area_mm2: Annotated[float | None, positive(BAR, "A", "or its cross-section, mm^2")] = None
    bar_modulus_gpa: Annotated[float | None, positive(BAR, "E", "Young's modulus, GPa")] = None
    bar_density_kg_m3: Annotated[float | None, positive(BAR, "RHO", "density, kg/m3")] = None
    bar_wave_speed_m_s: Annotated[float | None, positive(BAR, "C", "or speed of a long wave, m/s")] = None
    gauge_distance_mm: Annotated[float | None, _magnitude(BAR, "L", "from the struck end to the gauge, mm")] = None
    bar_length_mm: Annotated[
        float | None,
        positive(
            BAR,
            "L",
            "from the struck end to the far end, mm: the force ends where the reflection arrives (no reflection)",
        ),
    ] = None
    sd_bar_percent: Annotated[
        float,
        percent(BAR, "SD", "standard deviation of modulus times cross-section times the gauge's sensitivity, %"),
    ] = 0.0
    compression_positive: Annotated[bool, switch(BAR, "the record shows compression as positive (negative)")] = False
    delay_ms: Annotated[
        float | None,
        finite(BAR, "T", "time of the record's clock at time 0 of the track, ms (where both forces agree best)"),
    ] = None
    sd_delay_ms: Annotated[float, _magnitude(BAR, "SD", "its standard deviation")] = 0.0

    def __post_init__(self) -> None:
        check_ranges(self, INSTRUMENT_SETTINGS)
        if sum(path is not None for path in (self.gate, self.accelerometer, self.strain_gauge)) != 1:
            raise SettingError("give one of `gate`, `accelerometer` and `strain_gauge`")
        if self.strain_gauge is None:
            self._require_no_bar()
        else:
            self._require_bar()
        if self.gate is not None:
            if self.spacing_mm is None:
                raise SettingError("`gate` needs `spacing_mm`, the distance of the two barriers")
            for name in ("plot", "unit"):
                if getattr(self, name) is not None:
                    raise SettingError(f"`{name}` is for an accelerometer or a bar; leave it out with `gate`")
        elif self.unit is not None:
            self._require_unit(self.quantity)

    @property
    def path(self) -> Path:
        """The file."""
        path = self.gate or self.accelerometer or self.strain_gauge
        assert path is not None  # one of three was given
        return path

    @property
    def quantity(self) -> Quantity:
        """What the file of an accelerometer or of a strain gauge holds."""
        return ACCELERATION if self.strain_gauge is None else STRAIN

    def _require_unit(self, quantity: Quantity) -> None:
        assert self.unit is not None
        try:
            quantity.factor(self.unit)
        except ValueError:
            units = ", ".join(quantity.factors)
            raise SettingError(
                f"`unit` = {shown_value(self.unit)}: expected a unit of {quantity.name} ({units}), or the "
                f"number of {quantity.si} in the file's unit"
            ) from None

    def _require_no_bar(self) -> None:
        of_bar = (setting for setting in INSTRUMENT_SETTINGS.values() if setting.group is BAR)
        given = [f"`{setting.name}`" for setting in of_bar if getattr(self, setting.name) != setting.default]
        if given:
            raise SettingError(f"{', '.join(given)}: of a bar; add `strain_gauge`, or leave it out")

    def _require_bar(self) -> None:
        needed = (
            (("bar_diameter_mm", "bar_area_mm2"), "its diameter or its cross-section"),
            (("bar_modulus_gpa",), "its modulus"),
            (("bar_density_kg_m3", "bar_wave_speed_m_s"), "its density or its wave speed"),
            (("gauge_distance_mm",), "the gauge's distance from the struck end"),
        )
        for names, words in needed:
            given = [name for name in names if getattr(self, name) is not None]
            if not given:
                listed = " or ".join(f"`{name}`" for name in names)
                raise SettingError(f"`strain_gauge` needs {words}: give {listed}")
            if len(given) > 1:
                raise SettingError(f"`{given[0]}` and `{given[1]}` were both given; leave one out")
        if self.bar_length_mm is not None and not self.bar_length_mm > (self.gauge_distance_mm or 0.0):
            raise SettingError(
                f"`bar_length_mm` = {self.bar_length_mm:g}: expected more than `gauge_distance_mm` = "
                f"{self.gauge_distance_mm:g}, the gauge's distance"
            )


#: All settings by name.
INSTRUMENT_SETTINGS = settings_of(InstrumentRequest)
