"""Registries to test on, by an identity and a git configuration that are no one's."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from calibrary.registry.git.repository import Repository, create
from calibrary.registry.git.writing import FileChange, Written, write
from calibrary.registry.paths import check_path

ENTRY = "cameras/dji/fc6310/5472x3648.yaml"
OTHER = "cameras/dji/fc330/4000x3000.yaml"

IDENTITY = {
    "GIT_COMMITTER_NAME": "Ada Keeper",
    "GIT_COMMITTER_EMAIL": "ada@example.com",
    "GIT_AUTHOR_NAME": "Ada Keeper",
    "GIT_AUTHOR_EMAIL": "ada@example.com",
}


NEEDED = {"GIT_EXEC_PATH"}


def seclude(patch: pytest.MonkeyPatch, home: Path) -> Path:
    """Make this a machine on which git is set up by nobody; the file that is the user's."""
    config = home / ".gitconfig"
    config.write_text("[init]\n\tdefaultBranch = main\n")
    for name in [name for name in os.environ if name.startswith("GIT_") and name not in NEEDED]:
        patch.delenv(name)
    variables = {"HOME": str(home), "GIT_CONFIG_GLOBAL": str(config), "GIT_CONFIG_NOSYSTEM": "1"}
    variables |= {"XDG_CACHE_HOME": str(home / ".cache"), "XDG_DATA_HOME": str(home / ".data")}
    for name, value in (variables | IDENTITY).items():
        patch.setenv(name, value)
    return config


@pytest.fixture(autouse=True)
def nobodys_git(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home and a git configuration of their own; the file that is the user's."""
    return seclude(monkeypatch, tmp_path_factory.mktemp("home"))


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bare and a checked-out registry to copy, which is quicker than making them."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        put(create(folder / "bare", bare=True, durable=False), {ENTRY: b"fx: 1.0\n"})
        packed(folder / "bare")
        repo = create(folder / "checked-out", durable=False)
        put(repo, {ENTRY: b"fx: 1.0\n", ".gitattributes": b"*.yaml text eol=lf\n"})
        packed(folder / "checked-out")
    return folder


@pytest.fixture
def bare(made: Path, tmp_path: Path) -> Iterator[Repository]:
    """A bare registry with one entry."""
    repo = Repository.open(
        shutil.copytree(made / "bare", tmp_path / "bare"), durable=False, check_path=check_path
    )
    yield repo
    repo.close()


@pytest.fixture
def checked_out(made: Path, tmp_path: Path) -> Iterator[Repository]:
    """A registry with a work tree and one entry."""
    path = shutil.copytree(made / "checked-out", tmp_path / "checked-out")
    git(path, "status")  # the index knows files by their inode, too
    repo = Repository.open(path, durable=False, check_path=check_path)
    yield repo
    repo.close()


def put(
    repo: Repository, files: Mapping[str, bytes | None], subject: str = "Change it", **options: object
) -> Written:
    """Write files from whatever they are now."""
    tip = repo.tip()
    changes = []
    for path, data in files.items():
        blob = repo.read(tip, path) if tip is not None else None
        changes.append(FileChange(path=path, data=data, base=blob.oid if blob is not None else None))
    return write(repo, changes, f"{subject}\n", **options)  # type: ignore[arg-type]  # as write takes them


def now(repo: Repository, path: str = ENTRY) -> bytes | None:
    """An entry's bytes at the tip."""
    tip = repo.tip()
    assert tip is not None
    blob = repo.read(tip, path)
    return blob.data if blob is not None else None


def packed(folder: Path) -> Path:
    """A registry to copy, its objects in one file: a folder for each of them takes longer to copy than to fill."""
    git(folder, "repack", "-a", "-d", "--quiet")
    return folder


def git(folder: Path, *arguments: str, code: int = 0) -> str:
    """Plain git, as a person would use it."""
    done = subprocess.run(["git", "-C", str(folder), *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr
    return done.stdout.strip()
