"""A registry that came as a folder, with a git folder of somebody else's making: nothing of it runs or is written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from calibrary.errors import RegistryError
from calibrary.registry.configuration import configuration_yaml
from calibrary.registry.git.history import history
from calibrary.registry.git.program import judge_settings, parse_settings
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import require_clean
from calibrary.registry.places import CONFIGURATION_FILE
from calibrary.registry.registry import uncommitted
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, now, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]


@pytest.fixture
def ran(tmp_path: Path) -> Path:
    """A file that is there once something ran."""
    return tmp_path / "ran"


def plant_filter(git_dir: Path, name: str, ran: Path, *, pattern: str = "*.yaml") -> None:
    """A filter that runs whenever git puts a file into the work tree, or looks at one there."""
    with (git_dir / "config").open("a") as file:
        file.write(f'[filter "{name}"]\n\tsmudge = touch {ran} && cat\n\tclean = touch {ran} && cat\n')
    (git_dir / "info").mkdir(exist_ok=True)
    (git_dir / "info" / "attributes").write_text(f"{pattern} filter={name}\n")


@pytest.mark.parametrize("name", ["plain", "", "two words", "a.b", "Ä"])
def test_a_filter_of_any_name_is_silenced(checked_out: Repository, ran: Path, name: str) -> None:
    plant_filter(checked_out.git_dir, name, ran)
    repo = Repository.open(checked_out.path, durable=False)
    put(repo, {ENTRY: b"fx: 2.0\n", OTHER: b"new\n"})
    assert (repo.path / ENTRY).read_bytes() == b"fx: 2.0\n"
    assert not ran.exists()


@pytest.mark.parametrize(
    "section",
    ['filter "a=b"', 'diff "a=b"', 'credential "https://a.example/?x=y"', 'http "https://a.example/?x=y"'],
)
def test_a_key_that_no_option_can_set_back_is_refused(checked_out: Repository, section: str) -> None:
    with (checked_out.git_dir / "config").open("a") as file:
        file.write(f"[{section}]\n\tsmudge = x\n\ttextconv = x\n\thelper = x\n\tcookieFile = x\n")
    with pytest.raises(RegistryError, match="--unset-all"):
        Repository.open(checked_out.path)


def test_a_configuration_that_is_a_link_is_the_repositorys_own_all_the_same(
    checked_out: Repository, ran: Path
) -> None:
    plant_filter(checked_out.git_dir, "evil", ran)
    config = checked_out.git_dir / "config"
    config.rename(checked_out.path / "elsewhere")
    config.symlink_to("../elsewhere")
    repo = Repository.open(checked_out.path, durable=False)
    put(repo, {ENTRY: b"fx: 2.0\n"})
    assert "filter.evil.smudge" in repo.silenced
    assert not ran.exists()


@pytest.mark.parametrize("ignore", ["", "\tignore = none\n"])
def test_a_repository_inside_is_not_looked_into(checked_out: Repository, ran: Path, ignore: str) -> None:
    put(checked_out, {CONFIGURATION_FILE: configuration_yaml()})
    inner = checked_out.path / "cameras" / "inner"
    inner.mkdir()
    git(inner, "init", "-q")
    (inner / "a.txt").write_text("a")
    git(inner, "add", ".")
    git(inner, "commit", "-qm", "inner")
    (checked_out.path / ".gitmodules").write_text(
        f'[submodule "i"]\n\tpath = cameras/inner\n\turl = ./i\n{ignore}'
    )
    git(checked_out.path, "-c", "advice.addEmbeddedRepo=false", "add", ".")
    git(checked_out.path, "commit", "-qm", "outer")
    plant_filter(inner / ".git", "evil", ran, pattern="*")
    os.utime(inner / "a.txt", (1, 1))
    assert uncommitted(checked_out) == ()
    require_clean(checked_out, checked_out.tip(), [f"cameras/x/y/{at}x1.yaml" for at in range(999)])
    assert not ran.exists()


def test_cookies_and_certificates_of_a_foreign_registry_are_not_used() -> None:
    said = {
        "http.cookiefile": "/home/me/.profile",
        "http.savecookies": "true",
        "http.https://a.example/.sslverify": "false",
        "http.sslcainfo": "theirs.pem",
        "http.extraheader": "of a CI",
    }
    listed = b"".join(b"file:/r/.git/config\0%s\n%s\0" % (k.encode(), v.encode()) for k, v in said.items())
    listed += b"file:/home/me/.gitconfig\0http.sslcainfo\nmine.pem\0"
    settings = parse_settings(listed, (Path("/r/.git"),), Path("/r"))
    flags, silenced = judge_settings(settings, "/r")
    last = dict(flag.partition("=")[::2] for flag in flags if flag != "-c")
    assert set(silenced) == said.keys() - {"http.extraheader"}
    assert last["http.cookiefile"] == ""
    assert last["http.savecookies"] == "false"
    assert last["http.https://a.example/.sslverify"] == "true"
    assert last["http.sslcainfo"] == "mine.pem"


@pytest.mark.parametrize("name", ["calibrary-sync", "calibrary-sync.new", "calibrary.lock"])
def test_a_link_in_the_place_of_a_note_is_not_written_through(
    checked_out: Repository, tmp_path: Path, name: str
) -> None:
    precious = tmp_path / "precious"
    precious.write_text("mine")
    (checked_out.git_dir / name).unlink(missing_ok=True)
    (checked_out.git_dir / name).symlink_to(precious)
    if name == "calibrary.lock":
        with pytest.raises(RegistryError, match="cannot be written"):
            put(checked_out, {ENTRY: b"fx: 2.0\n"})
    else:
        put(checked_out, {ENTRY: b"fx: 2.0\n"})
    assert precious.read_text() == "mine"


@pytest.mark.parametrize("note", [b"", b"\xff\xfe\x00", b"no commit main\n", b"0" * 40])
def test_a_note_that_says_nothing_is_passed_over(checked_out: Repository, note: bytes) -> None:
    (checked_out.git_dir / "calibrary-sync").write_bytes(note)
    put(checked_out, {ENTRY: b"fx: 2.0\n"})
    assert (checked_out.path / ENTRY).read_bytes() == b"fx: 2.0\n"
    assert not (checked_out.git_dir / "calibrary-sync").exists()


@pytest.mark.parametrize("how", ["graft", "replacement"])
def test_a_history_told_otherwise_in_the_git_folder_is_not_believed(bare: Repository, how: str) -> None:
    first = bare.tip()
    assert first is not None
    put(bare, {ENTRY: b"fx: 2.0\n"})
    put(bare, {ENTRY: b"fx: 3.0\n"})
    tip = bare.tip()
    assert tip is not None
    if how == "graft":
        (bare.git_dir / "info").mkdir(exist_ok=True)
        (bare.git_dir / "info" / "grafts").write_text(f"{tip} {first}\n")
    else:
        git(bare.path, "replace", f"{tip}:{ENTRY}", f"{first}:{ENTRY}")
    repo = Repository.open(bare.path)
    assert now(repo) == b"fx: 3.0\n"
    assert len(history(repo, ENTRY, tip)) == 3


def test_a_link_to_nowhere_in_the_place_of_a_note_makes_no_file_there(
    checked_out: Repository, tmp_path: Path
) -> None:
    (checked_out.git_dir / "calibrary-sync").symlink_to(tmp_path / "made")
    with pytest.raises(RegistryError, match="look at it, then remove it"):
        put(checked_out, {ENTRY: b"fx: 2.0\n"})
    assert not (tmp_path / "made").exists()
    assert now(checked_out) == b"fx: 1.0\n"
