"""Selecting entries: each operator as the manual says, fields by their short names, and the order of rows."""

from __future__ import annotations

import pytest

from calibrary.errors import InputError
from calibrary.registry.fields import Row
from calibrary.registry.query import find_field, parse_where, select, short_ids

ROWS: dict[str, Row] = {
    "old": {
        "label": "P4R-9",
        "intrinsics.fx": 3600.0,
        "provenance.date": "2024-12-31",
        "tags": ("lab", "Survey"),
        "proposed": False,
    },
    "new": {
        "label": "P4R-10",
        "intrinsics.fx": 3700.0,
        "provenance.date": "2026-05-07T10:00:00",
        "tags": ("field",),
        "proposed": True,
    },
    "bare": {"intrinsics.fx": 3650.0},
}


def chosen(where: str = "", sort: str | None = None) -> str:
    return " ".join(select([*ROWS.items()], parse_where(where), sort).paths)


@pytest.mark.parametrize(
    ("where", "expected"),
    [
        ("", "old new bare"),
        ("label", "old new"),
        ("!label", "bare"),
        ("label=p4r-9", "old"),
        ("label=p4r-9,P4R-10", "old new"),
        ("label!=P4R-9", "new bare"),
        ("label~4r-1", "new"),
        ("label!~4r-1", "old bare"),
        ("tags=survey", "old"),
        ("tags!=survey", "new bare"),
        ("proposed=yes", "new"),
        ("proposed=0", "old"),
        ("fx<3650", "old"),
        ("fx<=3650", "old bare"),
        ("fx>3650", "new"),
        ("fx>=3650", "new bare"),
        ("fx=3.65e3", "bare"),
        ("date=2026-05", "new"),
        ("date<2025", "old"),
        ("date<=2024-12-31", "old"),
        ("date>2024", "new"),
        ("label~p4r fx>3650", "new"),
        ('label="P4R-9"', "old"),
    ],
)
def test_a_condition_chooses_the_entries_of_which_it_holds(where: str, expected: str) -> None:
    assert chosen(where) == expected


@pytest.mark.parametrize("where", ["fx=wide", "!label=x", "label=", "=x", "fx<3650 %", "nothing=1"])
def test_what_is_no_condition_is_refused(where: str) -> None:
    with pytest.raises(InputError):
        chosen(where)


@pytest.mark.parametrize(
    ("sort", "expected"),
    [
        ("fx", "old bare new"),
        ("-fx", "new bare old"),
        ("label", "old new bare"),
        ("-label", "new old bare"),
        ("proposed,-fx", "old new bare"),
    ],
)
def test_rows_are_sorted_numbers_as_numbers_and_those_without_the_field_last(
    sort: str, expected: str
) -> None:
    assert chosen(sort=sort) == expected


def test_a_field_has_its_short_name_its_full_name_in_any_case_and_its_last_part() -> None:
    known = {"camera.image_size", "x-lab.Room", "quality.std.fx", "distortion.k1", "quality.std.k1"}
    names = ("fx", "LABEL", "camera.image-size", "room")
    assert [find_field(name, known) for name in names] == [
        "intrinsics.fx",
        "label",
        "camera.image_size",
        "x-lab.Room",
    ]
    with pytest.raises(InputError, match=r"k1 may be distortion\.k1, quality\.std\.k1"):
        find_field("k1", known)
    with pytest.raises(InputError, match="nearest: room"):
        find_field("roon", {"x-lab.room"})


def test_a_units_hash_is_as_short_as_its_model_allows_and_no_shorter_than_four_digits() -> None:
    size = "5472x3648+f8.8.yaml"
    one, two, other = (
        f"cameras/dji/{name}/{size}"
        for name in ("m/sn-0123456789ab", "m/sn-01234f6789ab", "n/sn-abcdefabcdef")
    )
    plain = f"cameras/dji/m/{size}"
    assert short_ids([one, other, plain], [one, two, other, plain]) == [
        "dji/m/sn-012345/5472x3648+f8.8",
        "dji/n/sn-abcd/5472x3648+f8.8",
        "dji/m/5472x3648+f8.8",
    ]


def test_a_proposal_is_told_from_the_entry_that_is_listed_with_it() -> None:
    used, proposed = "cameras/dji/m/5472x3648.yaml", "cameras/dji/m/5472x3648.yaml@proposed"
    assert short_ids([proposed], [used, proposed]) == ["dji/m/5472x3648"]
    first, second = short_ids([used, proposed], [used, proposed])
    assert first == "dji/m/5472x3648"
    assert second == f"{first}@proposed"
