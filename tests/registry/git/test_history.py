"""Who changed which entry when, by whatever taste the reader's git is set to; and a registry as its users hold it."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import InputError, RegistryError, UnknownCameraError
from calibrary.registry.fleet import Note, Registry
from calibrary.registry.git.conflicts import FileConflictError
from calibrary.registry.git.fast_import import Person
from calibrary.registry.git.history import ChangedFile, changed, history
from calibrary.registry.git.messages import compose, subject_of, trailers_of
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import ANY, Change
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]

EVIL_TASTE = """
[log]
\tshowRoot = false
\tfollow = true
\tshowSignature = true
\tdecorate = full
\tdate = relative
\tmailmap = true
\tdiffMerges = off
[color]
\tui = always
[diff]
\trenames = copies
\tnoprefix = true
\texternal = false
[format]
\tpretty = oneline
\tnotes = *
[core]
\tquotePath = true
\tabbrev = 4
\tpager = false
[i18n]
\tlogOutputEncoding = ISO-8859-1
[grep]
\tpatternType = perl
"""


def test_every_revision_of_an_entry_is_told_newest_first(bare: Repository) -> None:
    author = Person(name="Grace Ärmel", email="grace@example.com")
    put(
        bare, {ENTRY: b"fx: 2.0\n"}, subject="New lens\n\nCamera: dji/fc6310\nReason: new lens", author=author
    )
    put(bare, {OTHER: b"x\n"})
    put(bare, {ENTRY: None}, subject="Gone")
    tip = bare.tip()
    assert tip is not None
    gone, changed_, added = history(bare, ENTRY, tip)
    assert [revision.oid for revision in (gone, changed_, added)] == [
        None,
        blob_id(b"fx: 2.0\n"),
        blob_id(b"fx: 1.0\n"),
    ]
    assert changed_.author == author
    assert changed_.committer.name == "Ada Keeper"
    assert changed_.trailers == (("Camera", "dji/fc6310"), ("Reason", "new lens"))
    assert (gone.subject, gone.commit) == ("Gone", tip)
    assert changed_.committed.utcoffset() is not None
    assert len(history(bare, ENTRY, tip, most=2)) == 2
    assert len(history(bare, None, tip)) == 4


def test_a_users_own_taste_changes_nothing_of_what_is_told(bare: Repository, nobodys_git: Path) -> None:
    put(bare, {ENTRY: b"fx: 2.0\n"}, subject="Größer")
    put(bare, {ENTRY: None, OTHER: b"fx: 2.0\n"})
    tip = bare.tip()
    assert tip is not None
    plain = history(bare, ENTRY, tip), changed(bare, None, tip), changed(bare, f"{tip}~1", tip)
    git(bare.path, "notes", "add", "-m", "a note")
    with nobodys_git.open("a") as file:
        file.write(EVIL_TASTE)
    repo = Repository.open(bare.path)
    assert (history(repo, ENTRY, tip), changed(repo, None, tip), changed(repo, f"{tip}~1", tip)) == plain
    assert len(plain[0]) == 3


def test_the_history_of_an_entry_goes_on_across_a_move(bare: Repository) -> None:
    registry = Registry(bare)
    put(bare, {ENTRY: b"fx: 2.0\n"})
    note = Note(subject="The model's name was wrong", reason="typo")
    registry.move(ENTRY, OTHER, b"fx: 2.0\n", note, base=blob_id(b"fx: 2.0\n"))
    written = registry.put(OTHER, b"fx: 3.0\n", Note(subject="Again"), base=blob_id(b"fx: 2.0\n"))
    revisions = registry.history(OTHER)
    assert [revision.path for revision in revisions] == [OTHER, OTHER, ENTRY, ENTRY]
    assert revisions[0].commit == written.commit
    assert registry.history(OTHER, most=3) == revisions[:3]


def test_an_entry_merged_from_a_branch_keeps_the_commits_of_the_branch(checked_out: Repository) -> None:
    put(checked_out, {OTHER: b"side\n"}, branch="onboard/x", subject="on the side")
    put(checked_out, {ENTRY: b"fx: 2.0\n"})
    git(checked_out.path, "merge", "-q", "--no-ff", "-m", "merge", "onboard/x")
    tip = checked_out.tip()
    assert tip is not None
    assert [revision.subject for revision in history(checked_out, OTHER, tip)] == ["on the side"]


def test_a_shallow_history_ends_at_the_cut_and_is_known_to(bare: Repository, tmp_path: Path) -> None:
    put(bare, {ENTRY: b"fx: 2.0\n"})
    copy = clone(bare.path.as_uri(), tmp_path / "copy", bare=True, depth=1)
    tip = copy.tip()
    assert tip is not None
    assert len(history(copy, ENTRY, tip)) == 1
    assert copy.is_shallow
    assert not bare.is_shallow


def test_a_registry_of_one_commit_has_one_revision_and_no_difference(bare: Repository) -> None:
    tip = bare.tip()
    assert tip is not None
    assert [revision.oid for revision in history(bare, ENTRY, tip)] == [blob_id(b"fx: 1.0\n")]
    assert changed(bare, tip, tip) == ()
    assert changed(bare, None, tip) == (ChangedFile(path=ENTRY, before=None, after=blob_id(b"fx: 1.0\n")),)


def test_a_message_keeps_its_lines_whatever_a_value_holds() -> None:
    message = compose(
        "a\nb\x00c", body="one\n\ttwo", trailers=[("Reason", "x\nCamera: forged"), ("Grade", "")]
    )
    assert message == "a b c\n\none\ntwo\n\nReason: x Camera: forged\n"
    assert trailers_of(message) == (("Reason", "x Camera: forged"),)
    assert subject_of(message) == "a b c"
    assert trailers_of("Reason: a subject is no trailer\n") == ()
    assert trailers_of("s\n\nReason: x\nand some prose\n") == ()
    assert len(compose("x" * 500)) <= 101


def test_git_reads_our_trailers_as_we_do(bare: Repository) -> None:
    note = Note(
        subject="Calibrate",
        reason="new — lens",
        cameras=["dji/fc6310"],
        grade="calibrated",
        sources=["ab" * 32],
    )
    Registry(bare).put(OTHER, b"x\n", note, base=None)
    told = git(bare.path, "log", "-1", "--format=%(trailers:only,unfold)")
    assert [tuple(line.split(": ", 1)) for line in told.splitlines()] == [*trailers_of(note.message)]
    assert told.splitlines()[0] == "Camera: dji/fc6310"


@pytest.fixture
def registry(tmp_path: Path) -> Registry:
    made, written = Registry.init(tmp_path / "fleet", {"registry.yaml": b"layout: 1\n"}, durable=False)
    assert written.warnings == ()
    return made


def test_a_new_registry_is_clean_and_keeps_the_bytes_of_entries(registry: Registry) -> None:
    folder = registry.repo.path
    assert git(folder, "status", "--porcelain") == ""
    assert sorted(path.name for path in folder.iterdir()) == [".git", ".gitattributes", "registry.yaml"]
    assert git(folder, "check-attr", "eol", "text", "--", ENTRY).splitlines() == [
        f"{ENTRY}: eol: lf",
        f"{ENTRY}: text: set",
    ]
    with pytest.raises(RegistryError, match="a git repository already"):
        Registry.init(folder, {})


def test_a_snapshot_follows_the_branch_and_old_ones_stay_as_they_were(registry: Registry) -> None:
    empty = registry.snapshot()
    assert dict(empty.paths) == {}
    files = {f"cameras/m/m{i}/a.yaml": b"n: %d\n" % i for i in range(1200)}
    registry.put_many([Change(path=path, data=data) for path, data in files.items()], Note(subject="import"))
    full = registry.snapshot()
    assert dict(registry.read_all(full)) == files
    assert registry.snapshot() is full
    base = blob_id(b"n: 7\n")
    registry.put("cameras/m/m7/a.yaml", None, Note(subject="drop"), base=base)
    registry.put(ENTRY, b"x\n", Note(subject="add"), base=None)
    patched = registry.snapshot()
    assert patched.paths == registry.repo.listing(patched.commit, "cameras")
    assert (len(full.paths), len(patched.paths)) == (1200, 1200)
    assert registry.snapshot(full.commit) is full
    assert [file.path for file in registry.changed(full.commit)] == [ENTRY, "cameras/m/m7/a.yaml"]


def test_an_entry_is_read_at_any_revision_or_named_as_missing(registry: Registry) -> None:
    first = registry.put(ENTRY, b"1\n", Note(subject="a"), base=None)
    registry.put(ENTRY, b"2\n", Note(subject="b"), base=first.paths[ENTRY])
    assert (registry.read(ENTRY).data, registry.read(ENTRY, first.commit).data) == (b"2\n", b"1\n")
    with pytest.raises(UnknownCameraError, match=f"{OTHER}: no such entry"):
        registry.read(OTHER)


def test_what_breaks_the_rules_of_entries_is_never_written(tmp_path: Path) -> None:
    def check(path: str, data: bytes) -> None:
        if b"fx" not in data:
            raise InputError("no fx", source=path)

    registry, _ = Registry.init(tmp_path / "fleet", {"README.md": b"hello\n"}, check=check, durable=False)
    before = registry.commit()
    with pytest.raises(InputError, match="no fx"):
        registry.put_many(
            [Change(path=ENTRY, data=b"fx: 1\n"), Change(path=OTHER, data=b"oops\n")], Note(subject="x")
        )
    assert registry.commit() == before


def test_an_entry_cannot_be_overwritten_blindly(registry: Registry) -> None:
    with pytest.raises(RegistryError, match="never overwritten blindly"):
        registry.put_many([Change(path=ENTRY, data=b"x\n", base=ANY)], Note(subject="x"))
    registry.put(ENTRY, b"1\n", Note(subject="a"), base=None)
    with pytest.raises(FileConflictError):
        registry.put(ENTRY, b"2\n", Note(subject="a"), base=None)
