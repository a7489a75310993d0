"""Any value for any setting: a refusal in a sentence, or a setting; never another error."""

import contextlib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from torchsphere.cli.main import main
from torchsphere.instruments.instrument_request import InstrumentRequest
from torchsphere.planning.plan_request import PlanRequest
from torchsphere.request import Request
from torchsphere.settings.configuration import read_toml
from torchsphere.settings.setting import Setting, settings_of

HUGE = int("9" * 400)
NUMBERS = st.sampled_from([HUGE, -HUGE, 0, -1, 1, 5e-324, -5e-324, 1e308, -1e308]) | st.integers() | st.floats()
TEXTS = st.sampled_from(["", "9" * 400, "-" + "9" * 5000, "1e400", "nan", "0:0", ":", "9" * 30 + ":", "a\0b", ","])
ANY = NUMBERS | TEXTS | st.text(max_size=20) | st.booleans() | st.none()
VALUES = st.recursive(ANY, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner))

#: Requests with what each needs.
NEEDED: dict[type, dict[str, Any]] = {
    Request: {"input": Path("a"), "out": Path("b")},
    PlanRequest: {},
    InstrumentRequest: {"accelerometer": Path("a")},
}
ALL = [(request_type, setting) for request_type in NEEDED for setting in settings_of(request_type).values()]
QUICK = settings(max_examples=40, deadline=None, database=None, suppress_health_check=[HealthCheck.too_slow])


@pytest.mark.parametrize(("request_type", "setting"), ALL, ids=lambda each: getattr(each, "name", ""))
@QUICK
@given(value=VALUES)
@example(value="-" + "9" * 5000)
def test_a_value_of_toml_or_of_a_cell_is_taken_or_refused(request_type: type, setting: Setting, value: Any) -> None:
    read = setting.from_text if isinstance(value, str) else setting.from_toml
    try:
        request_type(**NEEDED[request_type] | {setting.name: read(value)})
    except ValueError as refusal:
        sentence = str(refusal)
        assert sentence, "a refusal without a reason"
        assert len(sentence) < 1000
        assert "\n" not in sentence


@pytest.mark.parametrize("text", ["a = " + "[" * 5000, "a" + ".a" * 5000 + " = 1", "fps = " + "9" * 400, "x = 2e9999"])
def test_a_configuration_without_sense_is_refused_in_a_sentence(
    tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    with contextlib.suppress(ValueError):
        read_toml(path)
    assert main(["track", "a.npy", "--out", str(tmp_path / "out"), "--config", str(path)]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("torchsphere: ")
    assert len(printed) < 1000
