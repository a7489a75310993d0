"""Files as loggers and oscilloscopes write them: the same two signals in many dialects, or a refusal with the line."""

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from torchsphere.instruments.signal_file import Signals, read_signals
from torchsphere.settings.limits import SettingError

COUNT, INTERVAL_S, START_S = 40, 2e-5, -1e-4

#: The two signals of all files: exact in four decimals.
NEAR, FAR = (np.round(np.sin(np.arange(COUNT) / 5 + phase), 4) for phase in (0.0, 1.0))


def table(
    separator: str, *heads: str, comma: bool = False, per_s: float = 1.0, start_s: float = START_S, end: str = "\n"
) -> str:
    """A file with times in ``per_s`` of a second and both signals below some lines."""
    times = (start_s + INTERVAL_S * np.arange(COUNT)) * per_s
    rows = [separator.join((f"{t:.7f}", f"{a:.4f}", f"{b:.4f}")) for t, a, b in zip(times, NEAR, FAR, strict=True)]
    return end.join((*heads, *(row.replace(".", ",") if comma else row for row in rows), ""))


def values(lead: str, separator: str = "\t", comma: bool = False, trail: str = "") -> list[str]:
    """Lines of both signals without times, behind ``lead``, in which {k} counts."""
    rows = [
        f"{lead.format(k=k)}{a:.4f}{separator}{b:.4f}{trail}" for k, (a, b) in enumerate(zip(NEAR, FAR, strict=True))
    ]
    return [row.replace(".", ",") for row in rows] if comma else rows


LABVIEW = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t{sign}
X_Columns\t{columns}
Time\t12:13:15{sign}5
***End_of_Header***\t

Channels\t2\t
Samples\t40\t40
Y_Unit_Label\tg\tg
X_Dimension\tTime\tTime
X0\t-1{sign}0E-4\t-1{sign}0E-4
Delta_X\t2{sign}0E-5\t2{sign}0E-5
***End_of_Header***\t\t
X_Value\tnear\tfar\tComment
"""

TEKTRONIX = """Model,MSO2024
Firmware Version,1.56

Point Format,Y,
Horizontal Units,s
Sample Interval,2e-05
Record Length,40
Vertical Units,g,g
Vertical Offset,0
,
Label,
"""

#: Text of a file, and the names and units of its signals.
FILES: dict[str, tuple[str, Sequence[str], Sequence[str]]] = {
    "commas": (table(",", "time_s,near,far"), ("near", "far"), ("", "")),
    "units in brackets": (table(",", "Time (ms),near [g],far [g]", per_s=1e3), ("near [g]", "far [g]"), ("g", "g")),
    "semicolons and decimal commas": (
        table(";", "Zeit [µs];nah [m/s²];fern", comma=True, per_s=1e6),
        ("nah [m/s²]", "fern"),
        ("m/s²", ""),
    ),
    "semicolons and points": (table(";", "t_ms;near;far", per_s=1e3), ("near", "far"), ("", "")),
    "tabs": (table("\t", "Rel. time [s]\tnear\tfar", end="\r\n"), ("near", "far"), ("", "")),
    "tabs and decimal commas": (table("\t", "t / ms\tnear\tfar", comma=True, per_s=1e3), ("near", "far"), ("", "")),
    "blanks": (table("  ", "Time (ms)  near (g)  far (g)", per_s=1e3), ("near(g)", "far(g)"), ("g", "g")),
    "quotation marks and decimal commas": (
        "\n".join(
            ['"t","near","far"']
            + [
                f'"{START_S + INTERVAL_S * k:.6f}","{NEAR[k]:.4f}","{FAR[k]:.4f}"'.replace(".", ",")
                for k in range(COUNT)
            ]
        ),
        ("near", "far"),
        ("", ""),
    ),
    "a remark with names": (table(" ", "# made by hand", "# time_s near far"), ("near", "far"), ("", "")),
    "no header": (table(","), ("column 2", "column 3"), ("", "")),
    "PicoScope": (
        table(";", "Time;Channel A;Channel B", "(ms);(V);(mV)", "", comma=True, per_s=1e3, end="\r\n"),
        ("Channel A", "Channel B"),
        ("V", "mV"),
    ),
    "units that nothing here measures": (
        table(";", "Zeit;Beschl. x;Temp", "s;ft/s²;kg", comma=True),
        ("Beschl. x", "Temp"),
        ("ft/s²", "kg"),
    ),
    "numbers of samples, without a unit of their own": (
        "\n".join(
            ["Nr;Zeit;near;far", "-;ms;mV;Gs"]
            + [f"{k};{row}" for k, row in enumerate(table(";", comma=True, per_s=1e3).splitlines())]
        ),
        ("near", "far"),
        ("mV", "Gs"),
    ),
    "Keysight": (table(",", "x-axis,1,2", "second,Volt,Volt"), ("1", "2"), ("Volt", "Volt")),
    "LeCroy": (
        table(",", "LECROYWS434,12345,Waveform", "Segments,1,SegmentSize,40", "#1,19-Mar-2012 15:17:17,0", "Time,A,B"),
        ("A", "B"),
        ("", ""),
    ),
    "Tektronix": (TEKTRONIX + table(",", "TIME,CH1,CH2"), ("CH1", "CH2"), ("g", "g")),
    "Tektronix with numbers beside what they mean": (
        "\n".join(
            f"{lead},{row},"
            for lead, row in zip(
                ["Record Length,4.0e+01,", "Sample Interval,2.0e-05,", "Vertical Units,V,", *[",,"] * 37],
                table(",").splitlines(),
                strict=True,
            )
        ),
        ("column 5", "column 6"),
        ("", ""),
    ),
    "Rigol": (
        "\n".join(
            ["X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-1.0e-04,2.0e-05", *values("{k},", ",", trail=",")]
        ),
        ("CH1", "CH2"),
        ("Volt", "Volt"),
    ),
    "LabVIEW with times": (
        LABVIEW.format(sign=".", columns="One") + table("\t"),
        ("near", "far"),
        ("g", "g"),
    ),
    "LabVIEW without times": (
        LABVIEW.format(sign=",", columns="No") + "\n".join(values("\t", comma=True)),
        ("near", "far"),
        ("g", "g"),
    ),
}


def read(tmp_path: Path, text: str | bytes, **options) -> Signals:
    path = tmp_path / "signals.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_signals(path, **options)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16", "utf-16-le"])
@pytest.mark.parametrize("kind", FILES)
def test_files_of_many_kinds_hold_the_same_signals(tmp_path: Path, kind: str, encoding: str) -> None:
    text, names, units = FILES[kind]
    found = read(tmp_path, text.encode(encoding))
    assert (*found.values,) == (*names,)
    assert (*found.units.values(),) == (*units,)
    np.testing.assert_allclose(found.time_s, START_S + INTERVAL_S * np.arange(COUNT), atol=1e-9)
    np.testing.assert_array_equal([found.values[name] for name in names], [NEAR, FAR])
    # The lines that a refusal would name.
    lines = text.replace("\r\n", "\n").split("\n")
    for signal, sample in ((NEAR, 0), (FAR, 7), (NEAR, COUNT - 1)):
        assert f"{signal[sample]:.4f}" in lines[found.lines[sample] - 1].replace(",", ".")
    assert not found.warnings


RATE_HZ = 51.2e3


def clock(seconds: float) -> str:
    """Time of day in German."""
    return f"{int(seconds // 3600):02d}:{int(seconds // 60 % 60):02d}:{seconds % 60:09.6f}".replace(".", ",")


#: Times of even samples as loggers write them: head, text of a time in s, and the largest difference from true ones.
TIMES: dict[str, tuple[str, Callable[[float], str], float]] = {
    "rounded": ("Time (ms)", lambda t: f"{1e3 * t:.2f}", 5e-6),
    "cut off": ("Time (ms)", lambda t: f"{math.floor(1e5 * t + 1e-6) / 100:.2f}", 1e-5),
    "repeated": ("Time (s)", lambda t: f"{t:.4f}", 5e-5),
    "of single precision": ("Time (s)", lambda t: str(np.float32(0.91 + t)), 1e-7),
    "of six digits": ("Time (s)", lambda t: f"{0.9995 + t:.6g}", 5e-6),
    "in s since 1970": ("Time", lambda t: f"{1719999999 + t:.6f}", 1e-6),
    "in ms since 1970": ("Time", lambda t: f"{1719999999000 + 1e3 * t:.3f}", 1e-6),
    "in ns since 1970": ("Time", lambda t: str(1719999999123456789 + round(1e9 * t)), 1e-6),
    "with date": ("Timestamp", lambda t: f"2024-03-01T11:59:{58 + t:.6f}+01:00", 1e-6),
    "with a half of the day": ("Zeit", lambda t: f"03/01/2024 {clock(11 * 3600 + t)} PM", 1e-6),
    "around midnight": ("Zeit", lambda t: clock((86399.999 + t) % 86400), 1e-6),
}


@pytest.mark.parametrize("kind", TIMES)
def test_times_that_a_logger_rounded_or_counted_from_a_date_are_even(tmp_path: Path, kind: str) -> None:
    head, text, error_s = TIMES[kind]
    true = np.arange(4000) / RATE_HZ
    found = read(tmp_path, "\n".join([f"{head};a", *(f"{text(t)};{k % 7}" for k, t in enumerate(true))]))
    start = {"of single precision": 0.91, "of six digits": 0.9995}.get(kind, 0.0)
    np.testing.assert_allclose(found.time_s, start + true, rtol=0, atol=error_s)
    assert np.ptp(found.time_s) == pytest.approx(np.ptp(true), rel=1e-3)
    np.testing.assert_allclose(np.diff(found.time_s), 1 / RATE_HZ, rtol=0.01)
    assert not found.warnings


def test_times_that_are_too_coarse_to_tell_their_rate_are_refused(tmp_path: Path) -> None:
    rows = [f"{k / RATE_HZ:.3f},{k % 7}" for k in range(200)]
    with pytest.raises(SettingError, match="give sampling_hz"):
        read(tmp_path, "\n".join(["time_s,a", *rows]))


@pytest.mark.parametrize("step", [1e-4, 1e-6, 0.7e-6])
@pytest.mark.parametrize("digits", [6, 7])
def test_a_gap_is_no_rounding(tmp_path: Path, step: float, digits: int) -> None:
    index = np.arange(100)
    rows = [f"{step * (k + (k >= 60)):.{digits}f},{k % 7}" for k in index]
    with pytest.raises(SettingError, match="line 62: a step of") as refused:
        read(tmp_path, "\n".join(["time_s,a", *rows]))
    assert "--sampling-hz" in refused.value.as_options()
    assert "sampling_hz" in str(refused.value)
    found = read(tmp_path, "\n".join(["time_s,a", *rows]), sampling_hz=1e4)
    np.testing.assert_allclose(found.time_s, 1e-4 * index)
    assert list(found.values) == ["a"]


def test_the_unit_of_times_is_given_or_stated_and_a_contradiction_is_a_warning(tmp_path: Path) -> None:
    rows = [f"{k / 8},{k % 7}" for k in range(40)]
    for head, options, factor, said in (
        ("Time (ms)", {}, 1e-3, "in ms, as the file states"),
        ("t_us", {}, 1e-6, "in us, as the file states"),
        ("Time", {}, 1.0, "in s, as nothing states another"),
        ("Time", {"time_unit": "ms"}, 1e-3, "in ms, as given"),
        ("Time (min)", {"time_unit": "ms"}, 1e-3, "in ms, as given"),
    ):
        found = read(tmp_path, "\n".join([f"{head},a", *rows]), **options)
        np.testing.assert_allclose(found.time_s, factor * np.arange(40) / 8)
        assert said in found.times
        assert not found.warnings
    text = "\n".join(["Time (ms),a", *rows])
    (warning,) = read(tmp_path, text, time_unit="s").warnings
    assert "in ms by the file, and was taken as in s by `time_unit`" in warning
    with pytest.raises(SettingError, match="time_unit = 'min': expected one of s, ms, us, ns"):
        read(tmp_path, text, time_unit="min")
    assert read(tmp_path, text, sampling_hz=8000).warnings == ()
    (warning,) = read(tmp_path, text, sampling_hz=8).warnings
    assert "a sample every 0.000125 s, and `sampling_hz` says 0.125 s" in warning


ROWS = [f"{k / 8},{k % 7}" for k in range(40)]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "line 1: expected columns of numbers"),
        ("a word\nanother\n", "line 2: expected columns of numbers"),
        ("time_s,a\n1,2\n2,3\n", "expected 8 or more lines of numbers, got 2"),
        ("time_s,a,a\n" + "\n".join(f"{row},1" for row in ROWS), "has two columns 'a'"),
        ("\n".join(["time_s,a", *ROWS[:20], "2.5,x", *ROWS[21:]]), "line 22: expected a number in column 'a', got 'x'"),
        ("\n".join(["time_s,a", *ROWS[:20], "2.5,", *ROWS[21:]]), "line 22: expected a number in column 'a', got ''"),
        ("\n".join(["time_s,a", "0,x", *ROWS[1:]]), "line 2: expected 2 numbers as in the other lines"),
        ("\n".join(["time_s,a", *ROWS[:3], "x,1", *ROWS[4:]]), "line 5: expected 2 numbers as in the other lines"),
        ("\n".join(["time_s,a", *ROWS[:20], "2.5", *ROWS[21:]]), "line 22: expected 2 numbers"),
        ("\n".join(["time_s,a", *ROWS[:20], "2.5,1,1", *ROWS[21:]]), "line 22: expected 2 numbers"),
        ("\n".join(["time_s,a", *ROWS, "end"]), "line 42: expected 2 numbers as in the other lines, parted by commas"),
        ("\n".join(["time_s,a", *ROWS, "time_s,a", *ROWS]), "line 42: expected a number in column 'time_s'"),
        ("\n".join(["time_s,a", *ROWS, *ROWS]), "line 42: a step of -4.875 s in 'time_s'"),
        ("\n".join(["time_s,a", *(f"{k**2},1" for k in range(40))]), "a step of"),
        ("\n".join(["Time (min),a", *ROWS]), "column 'Time (min)' states 'min'"),
        ("\n".join(["a,b", *(f"{k % 3},{k % 7}" for k in range(40))]), "no column has times, among 'a', 'b'"),
        ("\n".join(["No.,b", *(f"{k},{k % 7}" for k in range(40))]), "if it counts units of time"),
        ('"time_s,a\n' + "\n".join(ROWS), "a quotation mark that is not closed"),
        ("PK\x03\x04 of a workbook", "is no text"),
        ("\0".join("binary"), "is no text"),
    ],
)
def test_a_file_without_signals_is_refused_with_its_line(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        read(tmp_path, text)


def test_a_column_of_one_channel_with_decimal_commas_is_no_two_columns(tmp_path: Path) -> None:
    text = "\n".join(["near", *(f"{value:.4f}".replace(".", ",") for value in NEAR)])
    found = read(tmp_path, text, sampling_hz=1e3)
    np.testing.assert_array_equal(found.values["near"], NEAR)


def test_a_value_beyond_the_range_of_an_oscilloscope_is_refused_with_its_line_where_it_is_used(tmp_path: Path) -> None:
    found = read(tmp_path, "\n".join(["Time (ms),a,b,c", "-0.125,0,2,3", *(f"{row},1,3" for row in ROWS), "5,∞,1,3"]))
    np.testing.assert_array_equal(found.signal("b")[:3], [2.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="line 43: 'a' is inf"):
        found.signal("a")
    with pytest.raises(ValueError, match="'c' is 3 in all lines; give the column with the event"):
        found.signal("c")


def test_columns_of_text_are_left_out(tmp_path: Path) -> None:
    found = read(tmp_path, "\n".join(["Date,Time (ms),Remark,a", *(f"2024-03-01,{k / 8},good,{k}" for k in range(40))]))
    assert list(found.values) == ["a"]
    with pytest.raises(SettingError, match="no column 'Remark' of numbers for time_column; it has 'Time "):
        read(
            tmp_path, "\n".join(["Time (ms),Remark,a", *(f"{k / 8},good,{k}" for k in range(40))]), time_column="Remark"
        )
