"""An entry's path follows from its key, and what could be no entry is none."""

from __future__ import annotations

from datetime import date
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.calibration import CameraKey, Grade, Provenance
from calibrary.errors import InputError
from calibrary.known_camera import match_key
from calibrary.records import replace
from calibrary.registry.entry import Entry, Sensor, Status, Validity
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.paths import check_path, path_of
from tests.registry.entries import an_entry


@pytest.mark.parametrize(
    ("fields", "path"),
    [
        ({"focal_mm": None}, "cameras/dji/fc6310r/5472x3648.yaml"),
        ({}, "cameras/dji/fc6310r/5472x3648+f8.8.yaml"),
        ({"focal_mm": 24.0, "sub_camera": "wide"}, "cameras/dji/fc6310r/5472x3648+sub-wide+f24.yaml"),
        ({"capture_mode": "zoom 2×"}, "cameras/dji/fc6310r/5472x3648+mode-zoom_2x+f8.8.yaml"),
        (
            {"lens": "XT 35 f/4", "focal_mm": None},
            "cameras/dji/fc6310r/5472x3648+lens-xt_35_f4~abf65eaeba.yaml",
        ),
        ({"serial": "9f2c"}, "cameras/dji/fc6310r/sn-9f2c/5472x3648+f8.8.yaml"),
        (
            {"firmware": FirmwareRange(min="01.00.0128")},
            "cameras/dji/fc6310r/5472x3648+f8.8+fw-01.00.0128.yaml",
        ),
        ({"firmware": FirmwareRange(max="1.9")}, "cameras/dji/fc6310r/5472x3648+f8.8+fw-to-1.9.yaml"),
    ],
)
def test_the_path_tells_the_key(fields: dict[str, Any], path: str) -> None:
    entry = an_entry(**fields)
    assert entry.path == path
    assert f"cameras/{entry.id}.yaml" == path


def keys() -> st.SearchStrategy[CameraKey]:
    word = st.text("aA+-_.~ f8", min_size=1, max_size=4) | st.just("a very long name " * 4)
    return st.builds(
        CameraKey,
        make=word,
        model=word,
        sub_camera=st.none() | word,
        lens=st.none() | word,
        capture_mode=st.none() | word,
        focal_mm=st.none() | st.sampled_from([8.8, 8.80001, 24.0]),
        image_size=st.sampled_from([(4, 3), (43, 1)]),
        serial=st.none() | word,
    )


def folded(key: CameraKey) -> tuple[object, ...]:
    values = (getattr(key, name) for name in CameraKey.__struct_fields__)
    return tuple(match_key(value) if isinstance(value, str) else value for value in values)


@given(keys(), keys())
def test_two_keys_share_a_path_exactly_if_they_match(one: CameraKey, other: CameraKey) -> None:
    assert (path_of(one) == path_of(other)) == (folded(one) == folded(other))


@given(keys())
def test_leaves_and_units_cannot_take_one_anothers_place(key: CameraKey) -> None:
    *_, parent, leaf = path_of(key).split("/")
    assert leaf[0].isdigit()
    assert leaf.endswith(".yaml")
    assert parent.startswith("sn-") == (path_of(key).count("/") == 4)


@given(keys())
def test_every_path_is_one_that_the_store_takes(key: CameraKey) -> None:
    assert check_path(path_of(key, FirmwareRange(min=f"version {'1.' * 40}2"))).startswith("cameras/")


@pytest.mark.parametrize(
    "fields", [{"make": None}, {"model": " "}, {"grade": Grade.SEED}, {"grade": Grade.PRIOR}]
)
def test_a_nameless_camera_or_a_guess_is_no_entry(fields: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        an_entry(**fields)


@pytest.mark.parametrize("tolerance", [0.0, -0.1, 1.5, float("nan")])
def test_a_tolerance_is_a_fraction(tolerance: float) -> None:
    with pytest.raises(InputError, match="tolerance"):
        an_entry(tolerance=tolerance)


def test_a_calibration_becomes_a_draft_and_its_firmware_part_of_its_making() -> None:
    made = an_entry().calibration
    found = Entry.of(replace(made, camera=replace(made.camera, firmware="01.09", image_size=None)))
    assert found.status is Status.DRAFT
    assert (found.firmware, found.calibration.camera.firmware) == (None, None)
    assert found.calibration.provenance.firmware == "01.09"
    assert found.calibration.camera.image_size == (5472, 3648)


def test_an_entrys_camera_names_no_firmware_beside_its_range() -> None:
    made = an_entry().calibration
    with pytest.raises(InputError, match="range"):
        Entry(calibration=replace(made, camera=replace(made.camera, firmware="01.09")))


def test_only_what_somebody_answers_for_is_usable() -> None:
    assert [status for status in Status if an_entry(status=status).is_usable] == [Status.APPROVED]


def test_a_validity_holds_its_first_and_its_last_day() -> None:
    may = Validity(first=date(2026, 5, 1), last=date(2026, 5, 31))
    assert may.holds(date(2026, 5, 1))
    assert may.holds(date(2026, 5, 31))
    assert not may.holds(date(2026, 6, 1))
    assert may.overlaps(Validity(first=date(2026, 5, 31)))
    assert not may.overlaps(Validity(last=date(2026, 4, 30)))


@pytest.mark.parametrize("days", [{}, {"first": date(2026, 5, 2), "last": date(2026, 5, 1)}])
def test_a_validity_without_days_is_refused(days: dict[str, date]) -> None:
    with pytest.raises(InputError):
        Validity(**days)


@pytest.mark.parametrize("sides", [{}, {"width_mm": 0.0}, {"pitch_um": float("inf")}])
def test_a_sensor_without_a_size_is_refused(sides: dict[str, float]) -> None:
    with pytest.raises(InputError):
        Sensor(**sides)


def test_provenance_is_the_calibrations() -> None:
    assert (
        an_entry(provenance=Provenance(kind="manual", operator="A. B.")).calibration.provenance.kind
        == "manual"
    )


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (Provenance(kind="manual"), "lacks operator"),
        (Provenance(kind="calibration-file", source="a.xml"), "lacks sha256"),
        (Provenance(kind="unstated", tool="x"), "does not name a source"),
        (Provenance(kind="seed"), "does not name a source"),
        (Provenance(kind="Lab"), "provenance.kind: 'Lab', expected text that matches"),
    ],
)
def test_an_entry_whose_provenance_could_not_be_read_back_is_not_made(made: Provenance, said: str) -> None:
    with pytest.raises(InputError, match=said):
        an_entry(provenance=made)
