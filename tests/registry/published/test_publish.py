"""``registry publish``: what is written, where, and what is left alone."""

from __future__ import annotations

import shutil
from datetime import date
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.calibration import CameraKey
from calibrary.errors import CalibraryError, InputError, RegistryError
from calibrary.known_camera import match_key
from calibrary.records import replace
from calibrary.registry.entry import Status, Validity
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.published.layout import camera_path, is_ours, sha256
from calibrary.registry.published.metadata import STATE_FIELD, TIMESTAMP_FILE, former
from calibrary.registry.published.write import _earlier, publish
from calibrary.registry.registry import open_snapshot
from calibrary.schemas import require
from tests.registry.entries import an_entry
from tests.registry.published.publications import (
    FLEET,
    UNIT,
    commit,
    dated,
    document,
    files_of,
    metadata,
    nobodys_git,
    published,
)

__all__ = ["nobodys_git"]


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    folder = tmp_path / "fleet"
    commit(folder, *FLEET)
    return folder


def digests(out: Path) -> dict[str, str]:
    """The digest of every file that the metadata vouch for, by its path."""
    found = {path: file.hashes["sha256"] for path, file in former(out).files.items()}
    for camera in tuple(found):
        for row in document(out, camera)["entries"]:
            for one in (row, *row["earlier"]):
                found[f"entries/{one['sha256'][:2]}/{one['sha256']}.json"] = one["sha256"]
    return found


def test_every_file_is_vouched_for_and_there_are_no_others(fleet: Path, tmp_path: Path) -> None:
    published(fleet, tmp_path / "out")
    files = files_of(tmp_path / "out")
    assert digests(tmp_path / "out") == {path: sha256(data) for path, data in files.items()}


def test_every_file_is_of_its_schema(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    state = document(out, metadata(out, "snapshot").relative_to(out).as_posix())["signed"][STATE_FIELD]
    require(state, "published-2")
    for path in files_of(out):
        if path.startswith(("models", "units")):
            require(document(out, path), "published-camera-1")
        elif path.startswith("entries"):
            require(document(out, path), "entry-1")


def test_a_camera_s_file_is_where_its_key_says_and_lists_its_entries(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    rows = document(out, "models/dji/fc6310r.json")["entries"]
    assert [(tuple(row["image_size"]), row["firmware"]) for row in rows] == [
        ((4864, 3648), None),
        ((5472, 3648), {"min": "01.09", "max": None}),
        ((5472, 3648), None),
    ]
    [unit] = document(out, f"units/dji/fc6310r/{UNIT[:2]}/{UNIT}.json")["entries"]
    data = (out / "entries" / unit["sha256"][:2] / f"{unit['sha256']}.json").read_bytes()
    assert parse_entry(data, "unit") == FLEET[2]
    assert document(out, "models/other/p4_rtk.json")["aliases"] == [
        {"make": "Bild & Flug", "model": "Weiß/Kamera"}
    ]


def test_drafts_and_proposals_are_not_published_and_retired_entries_say_so(
    fleet: Path, tmp_path: Path
) -> None:
    secret = an_entry(model="SECRET")
    commit(fleet, raw={f"proposals/{secret.id}.yaml": entry_yaml(secret)})
    published(fleet, tmp_path / "out")
    everything = b"".join(files_of(tmp_path / "out").values())
    assert b"DRAFT" not in everything
    assert b"SECRET" not in everything
    [row] = document(tmp_path / "out", "models/dji/fc330.json")["entries"]
    assert (row["status"], row["reason"]) == ("retired", "dropped")


def test_labels_and_tags_stay_private(fleet: Path, tmp_path: Path) -> None:
    commit(fleet, an_entry(serial=UNIT, label="P4R-03 of Ada", tags=("survey-north",)))
    published(fleet, tmp_path / "out")
    everything = b"".join(files_of(tmp_path / "out").values())
    assert b"Ada" not in everything
    assert b"survey-north" not in everything


def test_revisions_for_earlier_days_are_published_and_no_others(fleet: Path, tmp_path: Path) -> None:
    dated(fleet)
    commit(fleet, an_entry(focal_mm=None, fx=3662.0))
    published(fleet, tmp_path / "out")
    [row] = document(tmp_path / "out", "models/dji/dated.json")["entries"]
    assert [one["validity"] for one in row["earlier"]] == [
        {"from": "2026-03-01", "until": "2026-08-31"},
        None,
    ]
    rows = document(tmp_path / "out", "models/dji/fc6310r.json")["entries"]
    assert all(row["earlier"] == [] for row in rows)


def test_of_each_period_the_newest_revision_is_for_earlier_days_and_only_of_an_entry_with_days() -> None:
    now, once = (Validity.between(date(year, 1, 1), date(year, 12, 31)) for year in (2026, 2024))
    entry = an_entry(validity=now)
    revisions = [
        ("newest", entry),
        ("newer", an_entry(validity=once)),
        ("older", an_entry(validity=once, fx=3600.0)),
        ("always", an_entry()),
    ]
    assert [commit for commit, _ in _earlier(entry, revisions)] == ["newer", "always"]
    assert [*_earlier(an_entry(), revisions)] == []
    assert [*_earlier(replace(entry, status=Status.RETIRED), revisions)] == []


def test_the_same_commit_gives_the_same_bytes(fleet: Path, tmp_path: Path) -> None:
    dated(fleet)
    published(fleet, tmp_path / "one")
    shutil.copytree(fleet, tmp_path / "elsewhere")
    publish(open_snapshot(tmp_path / "elsewhere"), tmp_path / "two", workers=3)
    assert files_of(tmp_path / "one") == files_of(tmp_path / "two")


def test_only_what_changed_is_written_and_what_is_gone_is_removed(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    before = {path: (out / path).stat().st_mtime_ns for path in files_of(out)}
    assert published(fleet, out).written == 0
    commit(fleet, an_entry(focal_mm=None, fx=3662.0), raw={FLEET[5].path: None})
    done = published(fleet, out)
    after = {path: (out / path).stat().st_mtime_ns for path in files_of(out)}
    changed = {path for path in after if before.get(path) != after[path]}
    assert {path.partition("/")[0] for path in changed} == {"entries", "models"}
    # Beside these, the timestamp, the snapshot, and the lists of the files that changed or went.
    assert len(changed) == 2 < done.written <= 2 + 2 + 4
    assert done.removed == len(before.keys() - after.keys()) == 4
    published(fleet, tmp_path / "anew")
    assert files_of(out) == files_of(tmp_path / "anew")


def test_a_damaged_file_is_written_again(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    for path in (
        "models/dji/fc6310r.json",
        next(path for path in files_of(out) if path.startswith("entries")),
    ):
        (out / path).write_bytes(b"{")
    assert published(fleet, out).written == 2


def test_what_others_put_beside_it_stays(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    foreign = {
        "index.html": b"hello",
        "models/README.txt": b"x",
        "models/dji/mine.json": b'{"schema":"mine"}',
    }
    for path, data in foreign.items():
        (out / path).write_bytes(data)
    commit(fleet, raw=dict.fromkeys(entry.path for entry in FLEET[1:]))
    published(fleet, out)
    assert {path: data for path, data in files_of(out).items() if path in foreign} == foreign


def test_a_folder_of_something_else_is_refused(fleet: Path, tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "home/letter.txt").write_text("dear")
    with pytest.raises(InputError, match="name another folder"):
        published(fleet, tmp_path / "home")
    with pytest.raises(InputError, match="is a file"):
        published(fleet, tmp_path / "home/letter.txt")
    assert [*(tmp_path / "home").iterdir()] == [tmp_path / "home/letter.txt"]


def test_an_interrupted_run_leaves_the_former_state_and_the_next_one_completes_it(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    stamp = (out / TIMESTAMP_FILE).read_bytes()
    commit(fleet, an_entry(focal_mm=None, fx=3662.0))
    with monkeypatch.context() as patch:
        patch.setattr("calibrary.registry.published.output.Output.publish_staged", lambda _: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            published(fleet, out)
    assert (out / TIMESTAMP_FILE).read_bytes() == stamp
    (out / ".publishing/9-9").write_bytes(b"half")
    published(fleet, out)
    published(fleet, tmp_path / "anew")
    assert files_of(out) == files_of(tmp_path / "anew")
    assert {path.name for path in (out / ".publishing").iterdir()} == {"calibrary.lock", "state.json"}


def test_a_serial_number_in_clear_and_an_entry_of_another_camera_are_not_published(
    fleet: Path, tmp_path: Path
) -> None:
    commit(fleet, an_entry(serial="0V2LG3H0"))
    with pytest.raises(RegistryError, match="serial number is not hashed"):
        published(fleet, tmp_path / "out")
    assert not (tmp_path / "out" / TIMESTAMP_FILE).exists()


def test_a_plain_folder_has_no_commit_to_publish(tmp_path: Path) -> None:
    path = tmp_path / "plain" / an_entry().path
    path.parent.mkdir(parents=True)
    path.write_bytes(entry_yaml(an_entry()))
    with pytest.raises(RegistryError, match="no commit that could be published"):
        published(Path(f"folder:{tmp_path}/plain"), tmp_path / "out")


def test_many_cameras_are_listed_in_bins_and_no_file_gets_large(tmp_path: Path) -> None:
    commit(tmp_path / "fleet", *(an_entry(model=f"M {number}") for number in range(300)))
    out = tmp_path / "out"
    assert published(tmp_path / "fleet", out).cameras == 300
    assert digests(out) == {path: sha256(data) for path, data in files_of(out).items()}
    assert max(file.stat().st_size for file in (out / "metadata").iterdir()) < 100_000
    bins = {file.name: file.stat().st_mtime_ns for file in (out / "metadata").glob("*.bin-*.json")}
    assert len(bins) == 32
    commit(tmp_path / "fleet", an_entry(model="M 7", fx=3662.0))
    published(tmp_path / "fleet", out)
    after = {file.name: file.stat().st_mtime_ns for file in (out / "metadata").glob("*.bin-*.json")}
    # The former snapshot and the former list stay for readers who are given the former timestamp.
    assert len(bins.items() & after.items()) == 32
    assert len(after) == 33


class TestPaths:
    @pytest.mark.parametrize(
        ("make", "model", "path"),
        [
            ("DJI", "FC6310R", "models/dji/fc6310r.json"),
            ("Canon", "Canon  EOS 5D Mark IV ", "models/canon/canon_eos_5d_mark_iv.json"),
            ("Bild & Flug", "Weiß/Kamera", "models/bild_~26_flug/weiss~2fkamera.json"),
            ("..", ".x.-", "models/~2e~2e/~2ex.~2d.json"),
            ("a_b", "é", "models/a~5fb/~c3~a9.json"),
            ("\u200b", "x", "models/~/x.json"),
            ("m", "x" * 120, f"models/m/{'x' * 120}.json"),
        ],
    )
    def test_they_follow_from_make_and_model(self, make: str, model: str, path: str) -> None:
        assert camera_path(CameraKey(make=make, model=model)) == path

    @given(st.text(max_size=400), st.text(max_size=400))
    def test_names_that_are_told_apart_have_different_files(self, one: str, other: str) -> None:
        paths = {camera_path(CameraKey(make="m", model=text)) for text in (one, other)}
        assert len(paths) == len({match_key(one), match_key(other)})
        assert all(is_ours(path) and len(path) < 140 and path.isascii() for path in paths)
        assert all(".." not in part or part.strip(".") for path in paths for part in path.split("/"))


def test_no_file_is_written_where_something_cannot_be_read(fleet: Path, tmp_path: Path) -> None:
    commit(fleet, raw={"cameras/dji/bad/1x1.yaml": b"schema: ["})
    with pytest.raises(CalibraryError, match="bad/1x1"):
        published(fleet, tmp_path / "out")
    assert not (tmp_path / "out" / TIMESTAMP_FILE).exists()
