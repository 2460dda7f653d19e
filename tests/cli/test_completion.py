"""``completion``: what a real shell offers with the script."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from calibrary import parsers
from calibrary.cli.main import GROUPS, main
from calibrary.parsers.discovery import PROGRAMS

ASK = """\
source {script}
cd {folder}
COMP_WORDS=(calibrary {words})
COMP_CWORD={last}
_shtab_calibrary
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture
def script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    assert main(["completion", "bash"]) == 0
    path = tmp_path / "script.bash"
    path.write_text(capsys.readouterr().out)
    return path


def offered(script: Path, *words: str, folder: Path | None = None) -> set[str]:
    """What bash offers for the last word."""
    if shutil.which("bash") is None:
        pytest.skip("there is no bash here")
    quoted = " ".join(f"'{word}'" for word in words)
    command = ASK.format(script=script, folder=folder or script.parent, words=quoted, last=len(words))
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return {line.strip() for line in done.stdout.splitlines() if line.strip()}


def test_a_command_is_completed(script: Path) -> None:
    assert offered(script, "und") == {"undistort"}


def test_every_command_is_offered(script: Path) -> None:
    names = {name for _, commands in GROUPS for name, _ in commands}
    assert names <= offered(script, "")


def test_a_flag_is_completed(script: Path) -> None:
    assert offered(script, "undistort", "--cal") == {"--calibration"}


def test_choices_are_offered(script: Path) -> None:
    assert offered(script, "undistort", "--keep", "") == {"auto", "same", "all", "valid"}


def test_formats_are_offered_by_their_names(script: Path) -> None:
    written = {record.name for record in parsers.formats() if record.write is not None}
    assert offered(script, "convert", "a", "b", "--to", "") == written | set(PROGRAMS)
    assert offered(script, "inspect", "--format", "micm") == {"micmac", "micmac_xml"}


def test_files_complete_as_files_and_folders_as_folders(script: Path, tmp_path: Path) -> None:
    folder = tmp_path / "here"
    (folder / "flight").mkdir(parents=True)
    (folder / "first.xml").touch()
    assert offered(script, "inspect", "fi", folder=folder) == {"first.xml"}
    assert offered(script, "undistort", "first.xml", "--out", "f", folder=folder) == {"flight"}


@pytest.mark.parametrize(("shell", "begins"), [("zsh", "#compdef calibrary"), ("tcsh", "#")])
def test_other_shells_have_a_script_too(shell: str, begins: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert script.startswith(begins)
    assert "undistort" in script


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells_understand_their_script(
    shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell} here")
    main(["completion", shell])
    (tmp_path / "script").write_text(capsys.readouterr().out)
    done = subprocess.run([shell, "-n", tmp_path / "script"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_an_unknown_shell_is_a_usage_error() -> None:
    with pytest.raises(SystemExit) as ended:
        main(["completion", "cmd"])
    assert ended.value.code == 2
