"""Files that are no entries, and damaged ones: every command answers for every other camera, and the file is named."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from calibrary.jobs.fleet import Fleet
from calibrary.registry.init import init
from calibrary.registry.registry import open_snapshot
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import P4R, printed, run
from tests.jobs.extract.fleet import picture
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git, packed, seclude
from tests.thorough import every

USED = (
    an_entry(focal_mm=None),
    an_entry(make="Example", model="M77", focal_mm=None),
    an_entry(focal_mm=None, serial="0e25" * 4),
)
PLACES = (
    "cameras",
    "cameras/dji",
    "cameras/dji/fc6310r",
    f"cameras/dji/fc6310r/sn-{'0e25' * 4}",
)
JUNK = {
    "README.md": b"# Our cameras\n",
    ".DS_Store": b"\x00\x00\x00\x01Bud1",
    "5472x3648.yaml.orig": b"<<<<<<< ours\n",
    ".5472x3648.yaml.swp": b"b0VIM 8.2",
    "notes.yaml": b"fx: [1, 2\n",
    "raw.bin": b"\x00" * (20 << 20),
}
ASKED = ("--make", "DJI", "--model", "FC6310R", "--image-size", "5472x3648")
COMMANDS: dict[str, tuple[str, ...]] = {
    "list": ("list",),
    "resolve": ("resolve", *ASKED),
    "lock": ("lock", "--out", "out.lock"),
    "check": ("check",),
    "export": ("export", "--to", "csv", "--out", "out.csv"),
    "status": ("status",),
    "audit": ("audit", "flight"),
    "publish": ("publish", "public", "--workers", "1"),
}
WRITTEN = ("out.lock", "out.csv")


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A registry with three entries in use, to copy."""
    folder = tmp_path_factory.mktemp("clean")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        put(init(folder / "fleet").place, *USED)
        yield packed(folder / "fleet")


def said_of(
    capsys: pytest.CaptureFixture[str], fleet: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> dict[str, tuple[int, str, list[str]]]:
    """Exit code, messages and answers of every command."""
    monkeypatch.setenv("CALIBRARY_REGISTRY", str(fleet))
    folder.mkdir()
    monkeypatch.chdir(folder)
    picture(folder / "flight/a.jpg", make="DJI", model="FC6310R")
    found = {}
    for name, words in COMMANDS.items():
        code, out, err = run(capsys, *words)
        commit = git(fleet, "rev-parse", "HEAD")
        answers = [out, *(Path(one).read_text() for one in WRITTEN if Path(one).is_file())]
        plain = [text.replace(commit, "COMMIT").replace(commit[:12], "COMMIT") for text in answers]
        found[name] = (code, err + out, [text.replace(str(fleet), "FLEET") for text in plain])
    return found


@pytest.mark.parametrize("junk", every(4, JUNK))
def test_what_is_no_entry_changes_no_answer_and_is_named(
    junk: str,
    clean: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    expected = said_of(capsys, clean, tmp_path / "before", monkeypatch)
    fleet = shutil.copytree(clean, tmp_path / "fleet")
    for place in PLACES:
        (fleet / place).mkdir(parents=True, exist_ok=True)
        (fleet / place / junk).write_bytes(JUNK[junk])
    git(fleet, "add", "--all", "--force")
    git(fleet, "commit", "--quiet", "--message=junk")
    found = said_of(capsys, fleet, tmp_path / "after", monkeypatch)
    for name, (code, _, answers) in expected.items():
        if name not in {"check", "publish"}:
            assert (found[name][0], found[name][2]) == (code, answers), name
    assert found["publish"][0] == 0
    assert (expected["check"][0], found["check"][0]) == (0, int(junk.endswith(".yaml"))), found["check"][1]
    for place in PLACES:
        assert f"{place}/{junk}" in found["check"][1]
    assert "no camera's KEY" in " ".join(found["list"][1].split())


@pytest.mark.parametrize("data", [JUNK["notes.yaml"], b"", JUNK["raw.bin"], b"\x00no yaml"])
def test_a_damaged_file_of_an_entry_refuses_that_camera_alone(
    data: bytes,
    clean: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = shutil.copytree(clean, tmp_path / "fleet", ignore=shutil.ignore_patterns(".git"))
    shutil.rmtree(folder / "events")
    (folder / USED[1].path).write_bytes(data)
    monkeypatch.setenv("CALIBRARY_REGISTRY", f"folder:{folder}")
    monkeypatch.chdir(tmp_path)
    assert printed(capsys, "resolution-1", "resolve", *ASKED)["entry"]["id"] == P4R
    for words in (("list",), ("lock",), ("export", "--to", "csv", "--out", "out.csv")):
        code, out, err = run(capsys, *words)
        assert (code in {0, 1, 3}, USED[1].path in err + out) == (True, True), (words, code, out, err)
    assert "fc6310r" in Path("out.csv").read_text().lower()
    code, _, err = run(capsys, "resolve", "--make", "Example", "--model", "M77", *ASKED[4:])
    assert (code, USED[1].path in err) == (4, True)


def test_a_registry_with_a_damaged_configuration_answers_by_its_last_one(
    clean: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet = shutil.copytree(clean, tmp_path / "fleet")
    before = Fleet(fleet).snapshot.configuration
    file = fleet / "registry.yaml"
    file.write_text(file.read_text() + "layout: 3\n")
    git(fleet, "commit", "--quiet", "-am", "a key twice")
    monkeypatch.setenv("CALIBRARY_REGISTRY", str(fleet))
    assert Fleet(fleet).snapshot.configuration.policy == before.policy
    assert printed(capsys, "resolution-1", "resolve", *ASKED)["entry"]["id"] == P4R
    code, _, err = run(capsys, "list")
    assert (code, "registry.yaml: " in err, "what it said before counts" in " ".join(err.split())) == (
        0,
        True,
        True,
    )
    assert run(capsys, "check")[0] == 1
    code, _, err = run(capsys, "set", P4R, "+spare", "--yes")
    assert (code, "nothing was written: registry.yaml" in err) == (4, True)
    assert open_snapshot(Path(f"folder:{fleet}")).configuration.damage is not None
