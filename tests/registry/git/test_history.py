"""Who changed which entry when, by whatever taste the reader's git is set to; and a registry as its users hold it."""

from __future__ import annotations

from pathlib import Path

from calibrary.registry.git.history import ChangedFile, changed, histories, history
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import FileChange, Person, compose, subject_of, trailers_of, write
from calibrary.registry.proposals import message_of
from tests.registry.entries import an_entry
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


def test_an_entry_merged_from_a_branch_keeps_the_commits_of_the_branch(checked_out: Repository) -> None:
    put(checked_out, {OTHER: b"side\n"}, branch="onboard/x", subject="on the side")
    put(checked_out, {ENTRY: b"fx: 2.0\n"})
    git(checked_out.path, "merge", "-q", "--no-ff", "-m", "merge", "onboard/x")
    tip = checked_out.tip()
    assert tip is not None
    assert [revision.subject for revision in history(checked_out, OTHER, tip)] == ["on the side"]


def test_one_look_at_all_commits_finds_of_every_file_what_a_look_at_each_finds(
    bare: Repository, nobodys_git: Path
) -> None:
    third = OTHER.replace(".yaml", "-b.yaml")
    put(bare, {ENTRY: b"fx: 2.0\n", third: b"x\n"})
    put(bare, {third: None}, subject="Gone")
    changes = [
        FileChange(path=ENTRY, data=None, base=blob_id(b"fx: 2.0\n")),
        FileChange(path=OTHER, data=b"fx: 2.0\n"),
        FileChange(path="LICENSE", data=b"free\n"),
    ]
    tip = write(bare, changes, "Rename it\n").commit
    nobodys_git.write_text(nobodys_git.read_text() + EVIL_TASTE)
    repo = Repository.open(bare.path)
    found = histories(repo, tip, lambda path: ENTRY if path == "LICENSE" else path)
    each = {path: history(repo, path, tip) for path in (OTHER, third)}
    assert found == each | {ENTRY: history(repo, ENTRY, tip, beside="LICENSE")}
    assert [len(found[path]) for path in (ENTRY, OTHER, third)] == [3, 1, 2]


def test_where_commits_are_merged_git_decides_for_each_file(checked_out: Repository) -> None:
    put(checked_out, {OTHER: b"side\n"}, branch="onboard/x")
    put(checked_out, {ENTRY: b"fx: 2.0\n"})
    git(checked_out.path, "merge", "-q", "--no-ff", "-m", "merge", "onboard/x")
    tip = checked_out.tip()
    assert tip is not None
    assert histories(checked_out, tip, str) is None


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
    message = message_of("Calibrate", [an_entry()], "new — lens", {"cd" * 32: None})
    write(bare, [FileChange(path=OTHER, data=b"x\n")], message)
    printed = git(bare.path, "log", "-1", "--format=%(trailers:only,unfold)")
    assert [tuple(line.split(": ", 1)) for line in printed.splitlines()] == [*trailers_of(message)]
    assert printed.splitlines()[0] == f"Camera: {an_entry().id}"
