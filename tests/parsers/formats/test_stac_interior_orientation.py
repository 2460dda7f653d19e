"""STAC's interior orientation: an Item that pystac takes and the extension's rules hold for, and K by the formula."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import jsonschema
import pystac
import pytest

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.jobs.files import STAC_EXTENSION, with_interior_orientation
from calibrary.parsers.discovery import format_named
from calibrary.parsers.formats.stac_interior_orientation import FIELD, interior_orientation
from calibrary.records import replace


def _numbers(count: int, **limits: Any) -> dict[str, Any]:
    return {"type": "array", "minItems": count, "maxItems": count, "items": {"type": "number", **limits}}


INTERIOR_ORIENTATION: dict[str, Any] = {
    "type": "object",
    "properties": {
        "camera_id": {"type": "string"},
        "camera_manufacturer": {"type": "string"},
        "camera_model": {"type": "string"},
        "sensor_array_dimensions": _numbers(2, exclusiveMinimum=0, multipleOf=1),
        "pixel_spacing": _numbers(2, exclusiveMinimum=0),
        "focal_length": {"type": "number", "exclusiveMinimum": 0},
        "field_of_view": {"type": "number", "exclusiveMinimum": 0, "maximum": 360},
        "principal_point_offset": _numbers(2),
        "radial_distortion": _numbers(4),
        "affine_distortion": _numbers(6),
        "calibration_date": {"type": "string"},
    },
    # Stricter than the extension, which ignores what it does not know.
    "additionalProperties": False,
}
"""What v1.0.0 of the extension's schema asks of the object, in our words."""

MADE = Calibration(
    camera=CameraKey(make="DJI", model="FC6310R", focal_mm=8.8, image_size=(5472, 3648)),
    intrinsics=Intrinsics(fx=3661.4, fy=3655.2, cx=2731.5, cy=1847.1, image_size=(5472, 3648)),
    grade=Grade.CALIBRATED,
    provenance=Provenance(kind="test", date="2026-05-03"),
)
RAYS = [(-0.4, 0.3, 1.0), (0.0, 0.0, 2.0), (0.35, -0.2, 1.0), (1.0, 1.0, 4.0)]


def read(document: object) -> Calibration:
    [item] = parsers.decode(json.dumps(document).encode(), name="orientation.json")
    return item


def test_the_object_follows_the_extension_and_holds_k() -> None:
    data, verdict = parsers.encode([MADE], format_named("stac_interior_orientation"))
    document = json.loads(data)
    jsonschema.validate(document, INTERIOR_ORIENTATION)
    assert document["focal_length"] == pytest.approx(8.8)
    assert document["camera_model"] == "FC6310R"
    assert verdict.fits[0].exact
    x_mm, y_mm = document["pixel_spacing"]
    dx, dy = document["principal_point_offset"]
    # Photo coordinates from the middle of the sensor, mm, x right and y up; Y of the camera frame is down.
    for X, Y, Z in RAYS:
        x, y = dx + document["focal_length"] * X / Z, dy - document["focal_length"] * Y / Z
        expected = [5472 / 2 + x / x_mm, 3648 / 2 - y / y_mm]
        assert MADE.project([[X, Y, Z]])[0] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("kind", ["item", "collection", "alone"])
def test_items_collections_and_linked_documents_are_read(kind: str) -> None:
    stated = interior_orientation(MADE)
    documents: dict[str, Any] = {
        "item": {"type": "Feature", "properties": {FIELD: stated}, "assets": {}},
        "collection": {"type": "Collection", FIELD: stated},
        "alone": stated,
    }
    found = read(documents[kind])
    assert found.intrinsics == MADE.intrinsics or found.intrinsics.fx == pytest.approx(3661.4, rel=1e-14)
    assert found.distortion is None
    assert (found.camera.make, found.provenance.date) == ("DJI", "2026-05-03")
    assert interior_orientation(found)["pixel_spacing"] == pytest.approx(stated["pixel_spacing"])


def test_pystac_takes_an_item_with_it_and_gives_it_back() -> None:
    item = pystac.Item("DJI_0001", None, None, datetime(2026, 5, 3, tzinfo=UTC), {"gsd": 0.03})
    plain = item.to_dict()
    twice = with_interior_orientation(with_interior_orientation(plain, MADE), MADE)
    again = pystac.Item.from_dict(json.loads(json.dumps(twice)))
    assert again.stac_extensions == [STAC_EXTENSION]
    assert again.properties["gsd"] == 0.03
    assert read(again.to_dict()).intrinsics.cx == pytest.approx(2731.5)
    assert FIELD not in plain["properties"]
    whole = with_interior_orientation({"type": "Collection"}, MADE)
    assert (whole[FIELD]["focal_length"], whole["stac_extensions"]) == (pytest.approx(8.8), [STAC_EXTENSION])


def test_a_lens_is_named_as_left_out() -> None:
    lens = BrownConrady(k1=-0.27, k2=0.11, p1=0.0, p2=0.0, k3=0.0)
    _, verdict = parsers.encode(
        [replace(MADE, distortion=lens)], format_named("stac_interior_orientation"), drop_distortion=True
    )
    assert "distortion" in " ".join(verdict.dropped)


@pytest.mark.parametrize(
    ("change", "kind", "match"),
    [
        ({"radial_distortion": [0, 1e-4, 0, 0]}, UnsupportedModelError, "radial_distortion"),
        ({"affine_distortion": [1, 0, 0, 0, 1, 0]}, UnsupportedModelError, "affine_distortion"),
        ({"pixel_spacing": [0, 0.0024]}, ParseError, "positive"),
        ({"sensor_array_dimensions": [5472]}, ParseError, "1 numbers"),
        ({"focal_length": None}, ParseError, "focal_length"),
    ],
)
def test_what_is_not_defined_or_broken_is_refused(
    change: dict[str, Any], kind: type[Exception], match: str
) -> None:
    with pytest.raises(kind, match=match):
        read({**interior_orientation(MADE), **change})


def test_no_distortion_at_all_is_not_a_lens() -> None:
    assert read({**interior_orientation(MADE), "radial_distortion": [0, 0, 0, 0]}).distortion is None
