"""A registry that lost something: every command refuses with exit code 4, and says what is lost and what to do.

Each row of ``DAMAGE`` breaks a registry in one way; ``COMMANDS`` are all that read or write one. Whatever is broken, no
command answers out of the files in the work tree, which here claim to be approved and are not what was committed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.errors import RegistryError
from calibrary.records import replace
from calibrary.registry.cache import cache_folder
from calibrary.registry.registry import Registry
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import P4R, run, xml
from tests.jobs.extract.fleet import picture
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git
from tests.thorough import every

ENTRY = an_entry(focal_mm=None)
LOOSE_FX = "9661.25"
"""What the work tree says and no commit does."""


def objects(fleet: Path, oid: str) -> Path:
    """The file of a loose object."""
    return fleet / ".git/objects" / oid[:2] / oid[2:]


def lose(fleet: Path, name: str) -> None:
    """Remove the object that a name means."""
    objects(fleet, git(fleet, "rev-parse", name)).unlink()


def copied(fleet: Path, path: str) -> None:
    """The object of the newest commit gets the content that the one before it had: an old K passes as the new one."""
    new, old = (objects(fleet, git(fleet, "rev-parse", f"{commit}{path}")) for commit in ("HEAD", "HEAD~1"))
    assert new != old
    new.chmod(0o644)
    new.write_bytes(old.read_bytes())


def newest_approval(fleet: Path) -> str:
    """The statement that puts the newest content to use."""
    [added] = git(fleet, "diff", "--name-only", "HEAD~1", "HEAD", "--", "events").split()
    return added


def emptied(fleet: Path) -> None:
    (fleet / ".git/refs/heads/main").write_bytes(b"")


def zeroed(fleet: Path) -> None:
    (fleet / ".git/refs/heads/main").write_bytes(b"\0" * 41)


def branch_gone(fleet: Path) -> None:
    (fleet / ".git/refs/heads/main").unlink()


def branch_and_reflog_gone(fleet: Path) -> None:
    branch_gone(fleet)
    shutil.rmtree(fleet / ".git/logs", ignore_errors=True)


def orphan(fleet: Path) -> None:
    git(fleet, "symbolic-ref", "HEAD", "refs/heads/elsewhere")


def garbage(fleet: Path) -> None:
    (fleet / ".git/HEAD").write_bytes(b"\xff\xfe\x00garbage")


def head_gone(fleet: Path) -> None:
    (fleet / ".git/HEAD").unlink()


def objects_gone(fleet: Path) -> None:
    shutil.rmtree(fleet / ".git/objects")


def packed_refs(fleet: Path) -> None:
    git(fleet, "pack-refs", "--all")
    file = fleet / ".git/packed-refs"
    file.write_bytes(b"\x00\x01" + file.read_bytes()[9:])


def partial(fleet: Path) -> None:
    git(fleet, "config", "core.repositoryformatversion", "1")
    git(fleet, "config", "extensions.partialClone", "origin")
    git(fleet, "config", "remote.origin.promisor", "true")


FSCK, CLONE = "fsck --full", "calibrary registry init FOLDER --remote URL"
DAMAGE: dict[str, tuple[Callable[[Path], None], tuple[str, ...]]] = {
    "a branch whose file is empty": (emptied, ("refs/heads/main is empty", "reflog show main", FSCK, CLONE)),
    "a branch whose file is zeros": (zeroed, ("refs/heads/main is empty", "reflog show main")),
    "a branch that is lost": (branch_gone, ("the branch main is lost", "update-ref refs/heads/main")),
    "a branch that is lost with its reflog": (
        branch_and_reflog_gone,
        ("no branch, but 3 commits", "--lost-found"),
    ),
    "a HEAD that points to no branch": (
        orphan,
        ("no commit; there are: main", "symbolic-ref HEAD refs/heads/main"),
    ),
    "a HEAD of garbage": (garbage, ("HEAD contains", "ref: refs/heads/main")),
    "a HEAD that is lost": (head_gone, ("HEAD is missing", "ref: refs/heads/main", FSCK)),
    "objects that are lost": (objects_gone, ("has no objects", CLONE)),
    "a tip commit that is lost": (
        lambda fleet: lose(fleet, "HEAD"),
        ("which is missing", "reflog show main", FSCK),
    ),
    "a root tree that is lost": (
        lambda fleet: lose(fleet, "HEAD^{tree}"),
        ("it lacks a folder", FSCK, CLONE),
    ),
    "a root tree that is another's": (
        lambda fleet: copied(fleet, "^{tree}"),
        ("content of another one", FSCK),
    ),
    "packed refs that are garbled": (packed_refs, ("packed-refs", "expected a commit", FSCK)),
    "a partial clone": (partial, ("partial clone", "fetch --refetch --no-filter", "--unset-all")),
}
INSIDE: dict[str, tuple[Callable[[Path], None], tuple[str, ...]]] = {
    "a folder that is lost": (lambda fleet: lose(fleet, "HEAD:cameras"), ("it lacks a folder", FSCK, CLONE)),
    "a folder that is another's": (
        lambda fleet: copied(fleet, ":cameras/dji"),
        ("content of another one", FSCK),
    ),
    "an entry that is lost": (
        lambda fleet: lose(fleet, f"HEAD:{newest_approval(fleet)}"),
        (FSCK, CLONE),
    ),
}
"""What is found out only by those who read the entries."""

READ = (
    ("list",),
    ("show", P4R),
    ("resolve", P4R),
    ("resolve", "--make", "DJI", "--model", "FC6310R"),
    ("check",),
    ("export", "--to", "csv", "--out", "out.csv"),
    ("lock",),
    ("audit", "flight"),
    ("site", "pages"),
)
HISTORY = (("log", P4R), ("log",))
WRITE = (
    ("add", "lab.xml", "--make", "DJI", "--model", "FC330", "--yes"),
    ("approve", P4R, "--digest", "0" * 12),
    ("retire", P4R, "--reason", "x"),
    ("add", "catalogue", "--yes"),
    ("sync",),
)
COMMANDS: tuple[tuple[str, ...], ...] = (
    *(("registry", *words) for words in (*READ, *HISTORY, *WRITE)),
    ("extract", "flight", "--registry", "fleet", "--dry-run"),
    ("diff", P4R, f"{P4R}@HEAD~1"),
)


@pytest.fixture
def broken(fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A registry with two approved revisions of an entry, whose work tree claims a third one, and a flight."""
    for entry in (ENTRY, replace(ENTRY, tolerance=0.01)):
        put(fleet, entry)
    file = fleet / ENTRY.path
    file.write_text(file.read_text().replace("3661.25", LOOSE_FX))
    monkeypatch.chdir(tmp_path)
    picture(tmp_path / "flight/a.jpg", make="DJI", model="FC6310R")
    xml(tmp_path / "lab.xml")
    return fleet


def refused(capsys: pytest.CaptureFixture[str], command: tuple[str, ...], expected: tuple[str, ...]) -> None:
    """A command ends with 4, says what is expected, and answers nothing."""
    capsys.readouterr()
    try:
        code = main([*command])
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else 1
    said = capsys.readouterr()
    printed = " ".join(said.err.split())
    assert code == 4, (command, code, said)
    assert [words for words in expected if words not in printed] == [], (command, printed)
    assert LOOSE_FX not in said.out + said.err, command
    assert "approved" not in said.out, command


@pytest.mark.parametrize("damage", every(4, DAMAGE))
def test_no_command_takes_a_damaged_registry_for_another(
    broken: Path, damage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    breaks, expected = DAMAGE[damage]
    breaks(broken)
    for command in COMMANDS:
        refused(capsys, command, expected)


@pytest.mark.parametrize("damage", every(2, INSIDE))
def test_no_command_that_reads_an_entry_answers_with_another_or_with_none(
    broken: Path, damage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    breaks, expected = INSIDE[damage]
    # What an earlier run has read must not hide it either.
    assert main(["registry", "list"]) == 0
    breaks(broken)
    extract = ("extract", "flight", "--registry", "fleet", "--dry-run")
    # The list may know an entry from before, when it was verified: it is right, or it refuses.
    code, out, _ = run(capsys, "list")
    assert (code, "3661.25" in out, LOOSE_FX in out) in {(0, True, False), (4, False, False)}
    if "entry" not in damage:
        for words in (("resolve", P4R), ("check",)):
            refused(capsys, ("registry", *words), expected)
        for command in (("registry", "show", P4R), extract):
            refused(capsys, command, (FSCK, CLONE))
        return
    shutil.rmtree(cache_folder())
    goes_on = {"check", "list", "site", "audit"}
    for command in (*(("registry", *words) for words in READ if words[0] not in goes_on), extract):
        refused(capsys, command, expected)
    # These go on with the other entries, name the one, and fail.
    for words in (("check",), ("site", "pages"), ("audit", "flight")):
        code, out, err = run(capsys, *words)
        said = " ".join((out + err).split())
        assert (code, ENTRY.id in said, expected[0] in said, LOOSE_FX in said) == (1, True, True, False)


def test_an_object_whose_bytes_are_broken_is_refused(
    broken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = objects(broken, git(broken, "rev-parse", f"HEAD:{ENTRY.path}"))
    file.chmod(0o644)
    file.write_bytes(zlib.compress(b"blob 3\0abc"))
    refused(capsys, ("registry", "show", P4R), ("content of another one",))


@pytest.mark.parametrize("command", ["check", "list", "show"])
def test_a_file_much_too_large_is_told_by_its_path(
    command: str, fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (fleet / ENTRY.path).parent.mkdir(parents=True)
    (fleet / ENTRY.path).write_text("#" * (2 << 20))
    git(fleet, "add", "-A")
    git(fleet, "commit", "-m", "by hand")
    code, out, err = run(capsys, command, *([P4R] if command == "show" else []))
    assert (code != 0, f"{2 << 20} bytes, expected at most" in out + err, ENTRY.path in out + err) == (
        True,
    ) * 3


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_registry_of_another_user_is_opened_by_the_words_of_the_advice(
    broken: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    subprocess.run(["chown", "-R", "65534", str(broken)], check=True)
    for command in COMMANDS:
        refused(capsys, command, ("belongs to another user", "GIT_CONFIG_COUNT=1"))
    run(capsys, "list")
    _, _, err = run(capsys, "list")
    advice = dict(word.split("=", 1) for word in err.split() if word.startswith("GIT_CONFIG_"))
    for name, value in advice.items():
        monkeypatch.setenv(name, value)
    assert run(capsys, "list")[0] == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="only root becomes another user")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_git_folder_that_may_not_be_read_is_named(broken: Path) -> None:
    (broken / ".git").chmod(0o700)
    broken.chmod(0o755)
    above = {folder: folder.stat().st_mode for folder in broken.parents}
    reads, writes = os.pipe()
    try:
        for folder, mode in above.items():
            folder.chmod(mode | 0o055)
        child = os.fork()
        if child == 0:
            try:
                os.setuid(65534)
                Registry.open(broken)
            except RegistryError as error:
                os.write(writes, str(error).encode())
            finally:
                os._exit(0)
        os.close(writes)
        with os.fdopen(reads) as pipe:
            printed = pipe.read()
        os.waitpid(child, 0)
    finally:
        for folder, mode in above.items():
            folder.chmod(mode)
    assert f"{broken / '.git'}" in printed
    assert "cannot be read: Permission denied" in printed
    assert "init makes one" not in printed


class TestAPlainFolder:
    @pytest.fixture
    def folder(self, broken: Path, tmp_path: Path) -> Path:
        shutil.copytree(broken / "cameras", tmp_path / "files/cameras")
        file = tmp_path / "files" / ENTRY.path
        file.write_text(file.read_text().replace(LOOSE_FX, "3661.25"))
        return tmp_path / "files"

    def test_it_is_not_read_unless_it_is_named_as_one(
        self, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("CALIBRARY_REGISTRY", str(folder))
        for command in COMMANDS[:-2]:
            refused(capsys, command, ("without git", f"folder:{folder}"))
        refused(
            capsys, ("extract", "flight", "--registry", "files", "--dry-run"), ("without git", "folder:files")
        )

    def test_named_as_one_it_answers_what_needs_no_history(
        self, folder: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        answered: tuple[tuple[str, ...], ...] = (("list",), ("show", P4R), ("resolve", P4R), ("check",))
        for words in answered:
            code, out, _ = run(capsys, *words, "--registry", f"folder:{folder}")
            assert (code, P4R in out or words == ("check",)) == (0, True), words
        assert main(["extract", "flight", "--registry", "folder:files", "--dry-run"]) == 0
        for words in (HISTORY[0], WRITE[0], WRITE[1], ("site", "pages")):
            code, _, err = run(capsys, *words, "--registry", f"folder:{folder}")
            assert (code, "a plain folder" in err) == (4, True), words


class TestAFolderOfABiggerRepository:
    def test_every_command_refuses_it_alike_and_says_how_to_part_it(
        self,
        broken: Path,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        git(tmp_path, "init", "--quiet", "-b", "main", "project")
        shutil.copytree(broken, tmp_path / "project/fleet", ignore=shutil.ignore_patterns(".git"))
        git(tmp_path / "project", "add", ".")
        git(tmp_path / "project", "commit", "--quiet", "-m", "all of it")
        monkeypatch.setenv("CALIBRARY_REGISTRY", str(tmp_path / "project/fleet"))
        monkeypatch.chdir(tmp_path / "project")
        for name in ("flight", "lab.xml"):
            (tmp_path / "project" / name).symlink_to(tmp_path / name)
        for command in COMMANDS:
            refused(capsys, command, ("a folder of the one in", "subtree split --prefix=fleet -b registry"))


def shallow(fleet: Path, tmp_path: Path) -> Path:
    git(tmp_path, "clone", "-q", "--depth=1", fleet.as_uri(), "shallow")
    return tmp_path / "shallow"


def test_a_shallow_clone_answers_and_says_what_it_cannot(
    broken: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clone = shallow(broken, tmp_path)
    monkeypatch.setenv("CALIBRARY_REGISTRY", str(clone))
    for words in (["list"], ["resolve", P4R], ["check"]):
        assert run(capsys, *words)[0] == 0, words
    for words in (["show", P4R], ["log", P4R]):
        code, _, err = run(capsys, *words)
        assert (code, f"git -C {clone} fetch --unshallow" in " ".join(err.split())) == (0, True), words
    # The oldest commit of the clone did not record all that it holds.
    document: Any = Registry.open(clone)
    assert run(capsys, "show", P4R, "--json")[1].count('"recorded": null') == 1
    assert document.repo.is_shallow
    code, _, err = run(capsys, "check", "HEAD~1..HEAD")
    assert (code, "fetch --unshallow" in err) == (4, True)


def test_the_words_of_a_server_that_refuses_a_push_are_shown(
    broken: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    git(tmp_path, "clone", "-q", "--bare", str(broken), "server.git")
    hook = tmp_path / "server.git/hooks/pre-receive"
    hook.parent.mkdir(exist_ok=True)
    hook.write_text("#!/bin/sh\nprintf 'FC6310R: 1 of 2 \\033[31mapprovals\\n' >&2\nexit 1\n")
    hook.chmod(0o755)
    git(broken, "remote", "add", "origin", str(tmp_path / "server.git"))
    (broken / ENTRY.path).write_text("")
    git(broken, "checkout", "-q", "--", ".")
    assert run(capsys, "sync")[0] == 0
    put(broken, replace(ENTRY, tolerance=0.02))
    code, _, err = run(capsys, "sync")
    assert code == 4
    assert "pre-receive hook declined" in err
    assert "the server says: FC6310R: 1 of 2" in " ".join(err.split())
    assert "\033" not in err
