"""calibrary.open_registry: which calibration answers for an image, a KEY, a calibration; why, and what is near."""

from __future__ import annotations

import json
import shutil
from datetime import date
from pathlib import Path

import pytest

import calibrary
from calibrary.arguments import Terms
from calibrary.errors import InputError, RegistryError
from calibrary.records import replace
from calibrary.registry.entry import Status
from calibrary.schemas import require
from tests.registry.published.server import serving
from tests.workshop import CAMERA


@pytest.fixture
def fleet(furnished: Path) -> calibrary.Fleet:
    return calibrary.open_registry(furnished / "fleet")


def test_an_image_a_key_a_calibration_and_what_is_known_of_a_camera_are_answered_alike(
    fleet: calibrary.Fleet, furnished: Path
) -> None:
    image = furnished / "survey/DJI_0001.JPG"
    for camera in (image, str(image), "dji/fc6310r", CAMERA, CAMERA.camera):
        answer = fleet.resolve(camera)
        assert answer.status is Status.APPROVED
        assert answer.calibration is not None
        assert answer.calibration.intrinsics.fx == 3659.5
        assert answer.entry is not None
        assert answer.entry.id.startswith("dji/fc6310r/")
        assert answer.why


def test_the_calibration_is_brought_to_the_cameras_size(fleet: calibrary.Fleet) -> None:
    answer = fleet.resolve(replace(CAMERA.camera, image_size=(2736, 1824)))
    assert answer.calibration is not None
    assert answer.calibration.intrinsics.image_size == (2736, 1824)
    assert answer.calibration.intrinsics.fx == 3659.5 / 2


def test_where_none_answers_it_says_what_is_near(fleet: calibrary.Fleet) -> None:
    answer = fleet.resolve(replace(CAMERA.camera, image_size=(8000, 6000)))
    assert (answer.calibration, answer.entry, answer.status, answer.why) == (None, None, None, None)
    [near] = answer.near
    assert near.path.startswith("cameras/dji/fc6310r/")
    assert near.reason


def test_a_camera_without_a_name_and_a_file_without_a_camera_are_refused(
    fleet: calibrary.Fleet, furnished: Path
) -> None:
    with pytest.raises(InputError, match="make and model are not known"):
        fleet.resolve(calibrary.CameraKey())
    with pytest.raises(InputError, match=r"camera\.xml"):
        fleet.resolve(furnished / "camera.xml")
    with pytest.raises(RegistryError):
        fleet.resolve("nobody/knows-it")


def test_the_address_of_a_published_registry_opens_it(
    fleet: calibrary.Fleet, furnished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    fleet.publish(tmp_path / "public", workers=1)
    with serving(tmp_path / "public") as server:
        published = calibrary.open_registry(server.url)
        assert published.commit == fleet.commit
        answer = published.resolve(furnished / "survey/DJI_0001.JPG")
        assert (answer.registry, answer.status) == (server.url, Status.APPROVED)
        assert answer.calibration is not None
        assert answer.calibration.intrinsics.fx == 3659.5
        for cannot in (published.entries, published.check, lambda: published.show("dji/fc6310r")):
            with pytest.raises(RegistryError, match=f"^{server.url}: a published registry resolves cameras"):
                cannot()
        with pytest.raises(RegistryError, match="a revision is of one registry in git"):
            calibrary.open_registry(server.url, at="HEAD")
        with pytest.raises(RegistryError, match="nothing-here"):
            calibrary.open_registry(f"{server.url}nothing-here/")


def test_a_state_is_named_by_its_commit_and_holds_its_entries(
    fleet: calibrary.Fleet, furnished: Path
) -> None:
    assert fleet.commit is not None
    [entry] = fleet.entries()
    assert entry.calibration.intrinsics.fx == 3659.5
    again = calibrary.open_registry(furnished / "fleet", at=fleet.commit)
    assert list(again.entries()) == [entry]
    with pytest.raises(RegistryError):
        calibrary.open_registry(furnished / "fleet", at="no-such-tag")
    with pytest.raises(RegistryError):
        calibrary.open_registry(furnished / "survey")


def test_the_same_answer_is_one_member_of_a_set(fleet: calibrary.Fleet) -> None:
    assert len({fleet.resolve(CAMERA), fleet.resolve(CAMERA)}) == 1


def test_it_is_plain_data_by_the_commands_schema(fleet: calibrary.Fleet) -> None:
    document = fleet.resolve(CAMERA, on=date(2026, 5, 1)).to_dict()
    require(json.loads(json.dumps(document, allow_nan=False)), "resolution-1", source="to_dict")
    assert document["on"] == "2026-05-01"
    assert document["known_by"] == "what was said"


def test_a_serial_number_is_hashed_before_it_is_proposed_or_asked_for(
    furnished: Path, tmp_path: Path
) -> None:
    shutil.copytree(furnished / "fleet", tmp_path / "fleet")
    mine = calibrary.open_registry(tmp_path / "fleet")
    unit = calibrary.CameraKey(make="DJI", model="FC6310R", serial="0V2LG3H03")
    change = mine.propose(furnished / "camera.xml", camera=unit, terms=Terms(approve=True, reason="measured"))
    assert [one.id for one in change.proposals.items] == ["dji/fc6310r/sn-9bd2d9940c7c0724/5472x3648"]
    change.write()
    asked = replace(unit, image_size=(5472, 3648))
    for question in (asked, replace(asked, serial="9bd2d9940c7c0724")):
        answer = calibrary.open_registry(tmp_path / "fleet").resolve(question)
        assert answer.entry is not None
        assert answer.entry.id == "dji/fc6310r/sn-9bd2d9940c7c0724/5472x3648"


def test_a_listing_shows_the_columns_that_were_asked_for(fleet: calibrary.Fleet) -> None:
    assert fleet.listing(columns="label,intrinsics.fx").columns != fleet.listing().columns
    assert fleet.listing(columns="label,intrinsics.fx").columns == ("label", "intrinsics.fx")
