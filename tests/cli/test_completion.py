"""Completion by the shells."""

import shutil
import subprocess
from pathlib import Path

import pytest

from torchsphere.cli.main import main

#: Prints what bash offers after the words of a command line.
ASK = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}
function=$(complete -p torchsphere | sed 's/.*-F \\([^ ]*\\).*/\\1/')
$function torchsphere "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD-1]}"
printf '%s\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    assert main(["completion", "bash"]) == 0
    path = tmp_path / "completion.bash"
    path.write_text(capsys.readouterr().out)
    return path


def offered(script: Path, *words: str) -> list[str]:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("there is no bash to complete with")
    done = subprocess.run(
        [bash, "-c", ASK, "bash", str(script), "torchsphere", *words], capture_output=True, text=True, check=True
    )
    return [word.strip() for word in done.stdout.split()]


def test_bash_completes_commands_options_and_their_names(script: Path) -> None:
    assert {"track", "batch", "info", "completion"} <= set(offered(script, ""))
    assert offered(script, "tr") == ["track"]
    assert {"--diameter-mm", "--distance-mm", "--device", "--distortion"} <= set(offered(script, "track", "--d"))


@pytest.mark.parametrize(
    ("shell", "lines"),
    [("zsh", ("#compdef torchsphere", "--diameter-mm")), ("fish", ("complete -c torchsphere", "diameter-mm", "track"))],
)
def test_zsh_and_fish_have_their_scripts(shell: str, lines: tuple[str, ...], capsys) -> None:
    assert main(["completion", shell]) == 0
    printed = capsys.readouterr().out
    for line in lines:
        assert line in printed
