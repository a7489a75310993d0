"""What was probably meant, and help without arguments."""

import pytest

from torchsphere.cli.main import main
from torchsphere.settings.suggestion import did_you_mean


def test_torchsphere_alone_shows_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("usage: torchsphere")
    assert "first steps:\n  torchsphere demo\n  torchsphere info shot.cihx" in printed.out
    assert printed.err == ""


def test_an_example_in_a_help_text_is_a_command_to_be_copied(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["plan", "--help"])
    examples = capsys.readouterr().out.split("examples:\n")[1]
    lines = examples.replace(" \\\n     ", "").splitlines()
    assert lines[-1] == "  torchsphere plan --flight shot.cihx --diameter-mm 30 --mass-g 110 --out plan"
    assert [line.split()[:2] for line in lines] == [["torchsphere", "plan"]] * 2
    assert max(map(len, examples.splitlines())) <= 80


@pytest.mark.parametrize(
    ("arguments", "question"),
    [
        (["track", "a.tif", "--out", "r", "--diamter-mm", "30"], "did you mean --diameter-mm?"),
        (["track", "a.tif", "--out", "r", "--mass=110"], "did you mean --mass-g or --mass-sd-percent?"),
        (["track", "a.tif", "--out", "r", "--frame-rate", "100"], "did you mean --fps?"),
        (["track", "a.tif", "--output", "r"], "required: --out; --output is not an option; did you mean --out?"),
        (["track", "a.tif", "--diamter-mm=30"], "required: --out; --diamter-mm is not an option; did you mean --diam"),
        (["batch", "a", "--out", "r", "--wokers", "2"], "did you mean --workers?"),
        (["benchmark", "run", "b", "--out", "r", "--sute", "x"], "did you mean --suite?"),
        (["trak", "a.tif"], "did you mean track?"),
        (["track", "a.tif", "--out", "r", "b.tif"], "name all inputs one after the other, before the options"),
    ],
)
def test_an_unknown_word_is_answered_with_the_likeliest_one(
    arguments: list[str], question: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    error = capsys.readouterr().err
    assert question in error
    assert error.count("\n") == 1


def test_a_word_like_none_gets_no_question() -> None:
    assert did_you_mean("--zzzzzz", ["--fps", "--out"]) == ""


def test_an_unknown_key_of_a_file_is_answered_alike(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "c.toml").write_text("diamter_mm = 30")
    arguments = ["track", str(tmp_path / "a.tif"), "--out", str(tmp_path / "r"), "--config", str(tmp_path / "c.toml")]
    assert main(arguments) == 2
    assert "did you mean diameter_mm?" in capsys.readouterr().err
