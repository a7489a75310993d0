"""Refusals of the command line."""

from torchsphere.cli.main import main


def refused(arguments: list[str], capsys) -> str:
    """The sentence with which the command line refuses ``arguments``."""
    try:
        code = main(arguments)
    except SystemExit as stop:
        code = int(stop.code or 0)
    printed = capsys.readouterr()
    assert code != 0
    assert printed.out == ""
    sentence = printed.err.strip()
    assert sentence.startswith("torchsphere: ")
    assert "\n" not in sentence
    assert "Traceback" not in sentence
    assert len(sentence) > 30
    return sentence
