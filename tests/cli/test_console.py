"""What commands say on the standard error while they work: bars, steps that take long, warnings."""

import io
import logging
import sys

import pytest

from torchsphere.cli.console import loading_libraries, progress_bar, told_steps
from torchsphere.runtime import steps


def test_the_rate_of_the_second_pass_counts_from_its_own_start(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = io.StringIO()
    monkeypatch.setattr(sys, "stderr", shown)
    # A fast pass begins with frames that are done already.
    with progress_bar(False, "tracking", second_pass="on the map") as show:
        for done in (2, 40, 71, 0, 5, 71):
            show(done, 71)
    assert "on the map" in shown.getvalue()
    # tqdm writes a negative time and rate where it takes more frames off than are done.
    assert "<-" not in shown.getvalue()
    assert ", -" not in shown.getvalue()


def test_finished_recordings_of_an_archive_are_no_part_of_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress_bar(False, "", "recording") as show:
        show(90, 100)
        bar = show.__closure__[0].cell_contents
        assert bar.format_dict["initial"] == 90


def said(quiet: bool, verbose: bool, capsys: pytest.CaptureFixture[str]) -> list[str]:
    with told_steps(quiet, verbose):
        steps.tell("measuring %d frames", 7)
        logging.getLogger("torchsphere").info("measured")
        logging.getLogger("torchsphere.archive.dask_engine").warning("there are no workers")
    return capsys.readouterr().err.splitlines()


def test_long_steps_and_warnings_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert said(False, False, capsys) == [
        "torchsphere: measuring 7 frames ...",
        "torchsphere: there are no workers",
    ]


def test_verbose_prints_every_step_with_its_time_also_where_quiet_was_asked_for(capsys) -> None:
    for quiet in (False, True):
        lines = said(quiet, True, capsys)
        assert [line.split(" s  ")[1] for line in lines] == ["measuring 7 frames", "measured", "there are no workers"]


def test_quiet_leaves_the_steps_out(capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture) -> None:
    # The warning goes where it goes without the command line, here to pytest.
    assert said(True, False, capsys) == []
    assert caplog.messages == ["there are no workers"]


def test_the_libraries_are_announced_unless_they_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    told = []
    monkeypatch.setattr(steps, "tell", told.append)
    with loading_libraries():
        pass
    assert told == []
    monkeypatch.delitem(sys.modules, "torch")
    with loading_libraries():
        assert told == ["loading the libraries"]
