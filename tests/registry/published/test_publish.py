"""``registry publish``: what is written, where, and what is left alone."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from calibrary.errors import InputError, RegistryError
from calibrary.records import replace
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.paths import folder_of
from calibrary.registry.places import PUBLISHED_FILE
from calibrary.registry.published.cache import Cache
from calibrary.registry.published.manifest import sha256
from calibrary.registry.published.read import Published
from calibrary.registry.published.write import publish
from calibrary.registry.registry import open_snapshot
from calibrary.schemas import require
from tests.registry.entries import KEY, an_entry
from tests.registry.published.publications import (
    FLEET,
    UNIT,
    camera,
    commit,
    dated,
    document,
    files_of,
    listed,
    manifest,
    nobodys_git,
    published,
    rows_of,
)

__all__ = ["nobodys_git"]


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    folder = tmp_path / "fleet"
    commit(folder, *FLEET)
    return folder


def test_the_manifest_leads_to_every_file_and_there_are_no_others(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    named = {manifest(out)["cameras"], *listed(out)["cameras"].values()}
    assert {path: sha256(data) for path, data in files_of(out).items()} == {
        f"data/{one}.json": one for one in named
    }


def test_every_file_is_of_its_schema(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    dated(fleet)
    published(fleet, out)
    require(document(out, PUBLISHED_FILE), "published-3")
    require(listed(out), "published-list-1")
    for name in listed(out)["cameras"]:
        require(json.loads(camera(out, name).read_bytes()), "published-camera-3")


def test_a_camera_is_listed_by_its_folder_with_its_entries(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    assert [row["path"] for row in rows_of(out, "dji/fc6310r")] == sorted(
        entry.path for entry in (FLEET[0], FLEET[1], FLEET[3])
    )
    [unit] = rows_of(out, f"dji/fc6310r/sn-{UNIT}")
    assert parse_entry(json.dumps(unit["entry"]).encode(), "unit") == FLEET[2].as_draft
    own = folder_of("Bild & Flug", "Weiß/Kamera").removeprefix("cameras/")[:-1]
    assert listed(out)["aliases"] == {"other/p4_rtk": [own]}


def test_drafts_and_proposals_are_not_published_and_retired_entries_say_so(
    fleet: Path, tmp_path: Path
) -> None:
    secret = an_entry(model="SECRET")
    commit(fleet, raw={secret.path: entry_yaml(secret)})
    published(fleet, tmp_path / "out")
    everything = b"".join(files_of(tmp_path / "out").values())
    assert b"DRAFT" not in everything
    assert b"SECRET" not in everything
    [row] = rows_of(tmp_path / "out", "dji/fc330")
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
    [row] = rows_of(tmp_path / "out", "dji/dated")
    assert [one.get("validity") for one in row["others"]] == [
        {"from": "2026-03-01", "until": "2026-08-31"},
        {"from": None, "until": "2026-02-28"},
    ]
    rows = rows_of(tmp_path / "out", "dji/fc6310r")
    assert all(row["others"] == [] for row in rows)


def test_the_same_commit_gives_the_same_bytes(fleet: Path, tmp_path: Path) -> None:
    dated(fleet)
    published(fleet, tmp_path / "one")
    shutil.copytree(fleet, tmp_path / "elsewhere")
    publish(open_snapshot(tmp_path / "elsewhere"), tmp_path / "two")
    assert files_of(tmp_path / "one") == files_of(tmp_path / "two")


def test_only_what_changed_is_written_and_what_is_gone_is_removed(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    before = {path: (out / path).stat().st_mtime_ns for path in files_of(out)}
    assert published(fleet, out).written == 0
    commit(fleet, an_entry(focal_mm=None, fx=3662.0))
    done = published(fleet, out)
    after = {path: (out / path).stat().st_mtime_ns for path in files_of(out)}
    changed = {path for path in after if before.get(path) != after[path]}
    # The camera and the list; the manifest is the third.
    assert (len(changed), done.written) == (2, 3)
    assert done.removed == len(before.keys() - after.keys()) == 2
    published(fleet, tmp_path / "anew")
    assert files_of(out) == files_of(tmp_path / "anew")


def test_a_damaged_file_is_written_again(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    for file in (camera(out, "dji/fc6310r"), camera(out, "dji/fc330")):
        file.write_bytes(b"{")
    assert published(fleet, out).written == 2


def test_what_others_put_beside_it_stays(fleet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    published(fleet, out)
    foreign = {
        "index.html": b"hello",
        "data/README.txt": b"x",
        "data/mine.json": b'{"schema":"mine"}',
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
    former = (out / PUBLISHED_FILE).read_bytes()
    commit(fleet, an_entry(focal_mm=None, fx=3662.0))
    with monkeypatch.context() as patch:
        patch.setattr("calibrary.registry.published.write.signed_bytes", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            published(fleet, out)
    assert (out / PUBLISHED_FILE).read_bytes() == former
    (out / f"data/{'ab' * 32}.json").write_bytes(b"half")
    published(fleet, out)
    published(fleet, tmp_path / "anew")
    assert files_of(out) == files_of(tmp_path / "anew")


def test_an_entry_that_cannot_be_published_is_named_and_every_other_one_is(
    fleet: Path, tmp_path: Path
) -> None:
    damaged = f"events/cameras/dji/bad/1x1/2026-11-01-retire-ada-{'0' * 32}.json"
    commit(fleet, an_entry(serial="0V2LG3H0"), raw={damaged: b"{"})
    published(fleet, tmp_path / "out")
    snapshot = open_snapshot(fleet)
    for _ in range(2):  # what is unchanged is named again
        done = publish(snapshot, tmp_path / "out")
        named = {why.partition(":")[0] for why in done.refused}
        assert named == {"cameras/dji/bad/1x1.yaml", an_entry(serial="0V2LG3H0").path}
        assert done.entries == len(FLEET) - 1  # one is a draft
    assert b"0v2lg3h0" not in b"".join(files_of(tmp_path / "out").values()).lower()
    reader = Published(str(tmp_path / "out"), cache=Cache(tmp_path / "cache"))
    assert reader.index_for(KEY).resolve(KEY) is not None
    bad = replace(KEY, model="bad")
    with pytest.raises(RegistryError, match=r"bad/1x1.yaml: its keeper's registry has it and cannot read it"):
        reader.index_for(bad).resolve(bad)


def test_a_plain_folder_has_no_commit_to_publish(tmp_path: Path) -> None:
    path = tmp_path / "plain" / an_entry().path
    path.parent.mkdir(parents=True)
    path.write_bytes(entry_yaml(an_entry()))
    with pytest.raises(RegistryError, match="no commit that could be published"):
        published(Path(f"folder:{tmp_path}/plain"), tmp_path / "out")


def test_a_folder_of_the_former_form_is_left_alone(fleet: Path, tmp_path: Path) -> None:
    (tmp_path / "out/metadata").mkdir(parents=True)
    (tmp_path / "out/metadata/1.root.json").write_text("{}")
    with pytest.raises(InputError, match=r"earlier form \(metadata/.*empty it, or name another folder"):
        published(fleet, tmp_path / "out")
    assert not (tmp_path / "out" / PUBLISHED_FILE).exists()
