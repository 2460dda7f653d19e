"""A registry and its entries: KEY@REV is the K of that camera, at that state, or an error."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from calibrary.arguments import Terms
from calibrary.calibration import Provenance
from calibrary.errors import RegistryError, UnknownCameraError
from calibrary.records import replace
from calibrary.registry import proposals
from calibrary.registry.configuration import configuration_yaml
from calibrary.registry.entry import Alias, Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.errors import FileConflictError
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import ANY, FileChange, write
from calibrary.registry.history import history, recorded
from calibrary.registry.init import init
from calibrary.registry.paths import find_path, find_paths
from calibrary.registry.proposals import message_of, propose, propose_approvals, save, write_changes
from calibrary.registry.registry import Registry, open_snapshot
from tests.registry.entries import FILE, an_entry, put_entries
from tests.registry.git.repositories import git, nobodys_git

__all__ = ["nobodys_git"]


@pytest.fixture
def registry(tmp_path: Path) -> Registry:
    return Registry.open(init(tmp_path / "fleet").place)


def put(registry: Registry, entry: Entry, base: str | None = None) -> str:
    """Write an entry; its content's id."""
    oid = put_entries(registry, [(entry, base)], message_of("Put", [entry])).paths[entry.path]
    assert oid is not None
    return oid


def by_hand(registry: Registry, path: str, data: bytes) -> None:
    """Commit a file as somebody does who knows only git."""
    root = registry.repo.path
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_bytes(data)
    git(root, "add", ".")
    git(root, "commit", "-qm", "by hand")


def test_an_entry_is_removed_by_its_base_and_what_is_no_entry_is_not_written(registry: Registry) -> None:
    entry, note = an_entry(), message_of("Take it out")
    base = put(registry, entry)
    with pytest.raises(RegistryError):
        write_changes(registry.repo, [FileChange(path=entry.path, data=b"fx: 1\n", base=base)], note)
    write_changes(registry.repo, [FileChange(path=entry.path, data=None, base=base)], note)
    assert not (registry.repo.path / entry.path).exists()
    # What is approved of it stays in use.
    assert entry.path in registry.snapshot().paths


def test_a_file_that_the_commit_does_not_hold_is_named(registry: Registry) -> None:
    entry = an_entry()
    put(registry, entry)
    assert registry.snapshot().read(entry.path) == entry_yaml(entry)
    absent = an_entry(model="FC330").path
    with pytest.raises(RegistryError, match=re.escape(absent)):
        registry.snapshot().committed(absent)


def test_of_entries_with_another_k_proposed_three_are_named(registry: Registry) -> None:
    entries = [an_entry(model=f"FC{number}") for number in range(4)]
    put_entries(registry, [(entry, None) for entry in entries], "Put")
    paths, snapshot = [entry.path for entry in entries], registry.snapshot()
    drafts = [replace(entry, status=Status.DRAFT, tolerance=0.02) for entry in entries]
    put_entries(registry, [(one, snapshot.paths[one.path]) for one in drafts], "Propose")
    waiting = registry.snapshot()
    assert snapshot.waiting(paths) is None
    three, four = waiting.waiting(paths[:3]), waiting.waiting(paths)
    ids = [f"dji/fc{number}/5472x3648+f8.8" for number in range(3)]
    assert three is not None
    assert f"not used: {', '.join(ids)} (" in three
    assert f"not used: {', '.join(ids)} and 1 more (" in (four or "")


def test_one_cameras_file_in_anothers_place_is_nobodys_k(registry: Registry) -> None:
    entry, other, approved = an_entry(), an_entry(model="FC330"), an_entry(model="FC220")
    put(registry, approved)
    by_hand(registry, other.path, entry_yaml(entry))
    by_hand(registry, approved.path, entry_yaml(entry))
    for key in ("fc330", "fc330@HEAD", f"fc330@{registry.commit()}"):
        with pytest.raises(RegistryError, match=f"belongs at {entry.path}".replace("+", r"\+")):
            registry.get(key)
    assert registry.get("fc220").entry == approved


def test_a_file_at_a_path_of_nobodys_is_no_entry(registry: Registry) -> None:
    by_hand(registry, "cameras/mine.yaml", entry_yaml(an_entry()))
    assert registry.snapshot().strays == ("cameras/mine.yaml",)
    with pytest.raises(UnknownCameraError):
        registry.get("mine")


def test_a_key_is_found_in_any_letter_case_even_where_longer_ones_begin_alike() -> None:
    paths = [an_entry(focal_mm=None).path, an_entry().path]
    assert find_path(paths, "DJI/FC6310R/5472X3648") == paths[0]
    assert find_path(paths, "cameras/dji/fc6310r/5472x3648.yaml") == paths[0]
    assert find_paths(paths, "fc6310r") == sorted(paths)


def test_an_editors_name_does_not_hide_the_firmware_an_entry_is_of(registry: Registry) -> None:
    edited = replace(FILE, firmware="Adobe Lightroom Classic")
    put(registry, with_provenance(an_entry(firmware=FirmwareRange(min="01.00", max="01.10")), edited))
    assert registry.get("fc6310r@firmware:01.09").entry.firmware is not None
    with pytest.raises(UnknownCameraError, match="no revision"):
        registry.get("fc6310r@firmware:02.00")


def with_provenance(entry: Entry, provenance: Provenance) -> Entry:
    return replace(entry, calibration=replace(entry.calibration, provenance=provenance))


def test_what_was_written_is_told_as_written_whatever_becomes_of_the_packing(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: Repository, *, in_background: bool) -> None:
        raise RegistryError(f"no space, in_background={in_background}")

    monkeypatch.setattr(proposals, "is_due", lambda _: True)
    monkeypatch.setattr(proposals, "maintain", fails)
    entry = an_entry()
    put(registry, entry)
    assert registry.get("fc6310r").entry == entry


ENTRY_PATH = an_entry().path


def test_a_new_registry_is_clean_and_keeps_the_bytes_of_entries(registry: Registry) -> None:
    folder = registry.repo.path
    assert git(folder, "status", "--porcelain") == ""
    assert git(folder, "check-attr", "eol", "text", "--", ENTRY_PATH).splitlines() == [
        f"{ENTRY_PATH}: eol: lf",
        f"{ENTRY_PATH}: text: set",
    ]
    with pytest.raises(RegistryError, match="a registry already"):
        init(folder)


def test_a_snapshot_follows_the_branch_and_old_ones_stay_as_they_were(registry: Registry) -> None:
    empty = registry.snapshot()
    assert dict(empty.paths) == {}
    files = {f"cameras/m/m{i}/1x1.yaml": b"n: %d\n" % i for i in range(20)}
    write(registry.repo, [FileChange(path=path, data=data) for path, data in files.items()], "import\n")
    full = registry.snapshot()
    assert full.files == tuple(sorted(files))
    assert registry.snapshot() is full
    write(
        registry.repo,
        [FileChange(path="cameras/m/m7/1x1.yaml", data=None, base=blob_id(b"n: 7\n"))],
        "drop\n",
    )
    write(registry.repo, [FileChange(path=ENTRY_PATH, data=b"x\n")], "add\n")
    patched = registry.snapshot()
    assert patched.cameras == registry.repo.listing(patched.commit or "", "cameras")
    assert (len(full.cameras), len(patched.cameras)) == (20, 20)
    assert registry.snapshot(full.commit) is full
    assert [file.path for file in registry.changed(full.commit)] == [ENTRY_PATH, "cameras/m/m7/1x1.yaml"]


def test_an_entry_is_read_at_any_revision_or_named_as_missing(registry: Registry) -> None:
    first = put(registry, an_entry())
    commit = registry.commit()
    put(registry, replace(an_entry(), tolerance=0.01), first)
    assert registry.snapshot().read(ENTRY_PATH) == entry_yaml(replace(an_entry(), tolerance=0.01))
    for listed in (False, True):
        before = Registry.open(registry.repo.path).snapshot(commit)
        assert not listed or before.paths
        assert before.read(ENTRY_PATH) == entry_yaml(an_entry())
        with pytest.raises(RegistryError, match=f"nothing.yaml: not in commit {commit[:12]}"):
            before.read("cameras/nothing.yaml")


def test_what_is_no_entry_or_of_another_camera_is_never_written(registry: Registry) -> None:
    before = registry.commit()
    good = FileChange(path=ENTRY_PATH, data=entry_yaml(an_entry()))
    other = an_entry(model="FC330")
    for data, message in ((b"oops\n", "is not a map"), (entry_yaml(an_entry()), "belongs at")):
        with pytest.raises(RegistryError, match=message):
            write_changes(registry.repo, [good, FileChange(path=other.path, data=data)], message_of("x"))
    assert registry.commit() == before


def test_an_entry_cannot_be_overwritten_blindly(registry: Registry) -> None:
    data = entry_yaml(an_entry())
    with pytest.raises(RegistryError, match="written only against its base"):
        write_changes(registry.repo, [FileChange(path=ENTRY_PATH, data=data, base=ANY)], message_of("x"))
    put(registry, an_entry())
    with pytest.raises(FileConflictError):
        put(registry, replace(an_entry(), tolerance=0.01))


def test_a_plain_folder_is_a_snapshot_by_its_own_configuration(tmp_path: Path) -> None:
    entry = an_entry()
    (tmp_path / entry.path).parent.mkdir(parents=True)
    (tmp_path / entry.path).write_bytes(entry_yaml(entry))
    (tmp_path / "registry.yaml").write_bytes(configuration_yaml("source"))
    snapshot = open_snapshot(Path(f"folder:{tmp_path}"))
    assert (snapshot.commit, snapshot.repo, snapshot.configuration.policy.name) == (None, None, "source")
    assert snapshot.get("fc6310r").entry == entry
    assert [one.entry for one in snapshot.entries()] == [entry]
    with pytest.raises(RegistryError, match="a plain folder has no history"):
        history(snapshot)


def test_what_a_check_fails_is_not_saved(registry: Registry) -> None:
    put(registry, an_entry(model="FC330"))
    before = registry.commit()
    proposals = propose(
        registry.snapshot(), [an_entry(aliases=(Alias(make="DJI", model="FC330"),))], Terms(approve=True)
    )
    assert [finding.rule for finding in proposals.errors] == ["alias"]
    with pytest.raises(RegistryError, match="nothing was written"):
        save(registry, proposals)
    assert registry.commit() == before


def test_who_recorded_a_calibration_stays_whoever_approves_it(registry: Registry) -> None:
    written = save(registry, propose(registry.snapshot(), [an_entry(status=Status.DRAFT)]))
    git(registry.repo.path, "config", "user.name", "Somebody Else")
    again = Registry.open(registry.repo.path)
    save(again, propose_approvals(again.snapshot(), again.snapshot(), ["fc6310r"], Terms(reason="checked")))
    found = recorded(again.repo, again.get("fc6310r"))
    assert found is not None
    assert (found.commit, found.by, found.file) == (written.commit, "Ada Keeper", FILE.source)
    assert again.commit() != written.commit
