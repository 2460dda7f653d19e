"""K in the Items of a STAC catalogue, by the perspective imagery extension."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from calibrary.calibration import Calibration
from calibrary.parsers.formats.stac_interior_orientation import FIELD, interior_orientation

__all__ = ["EXTENSION", "with_interior_orientation"]

EXTENSION: Final = "https://stac-extensions.github.io/perspective-imagery/v1.0.0/schema.json"


def with_interior_orientation(item: Mapping[str, Any], calibration: Calibration) -> dict[str, Any]:
    """Return a copy of an Item or a Collection with K as ``pers:interior_orientation``, which has no distortion.

    Args:
        item: the Item as JSON, such as the result of ``pystac.Item.to_dict()``.
        calibration: calibration of the image's camera, at the image's size.

    >>> from calibrary.api.stac import with_interior_orientation
    >>> camera = calibrary.read("camera.xml")
    >>> item = {"type": "Feature", "properties": {"datetime": "2026-05-03T10:00:00Z"}, "assets": {}}
    >>> stated = with_interior_orientation(item, camera)["properties"]["pers:interior_orientation"]
    >>> stated["sensor_array_dimensions"]
    [5472, 3648]
    """
    stated = {FIELD: interior_orientation(calibration)}
    extensions = list(dict.fromkeys([*item.get("stac_extensions", ()), EXTENSION]))
    if item.get("type") == "Collection":
        return {**item, **stated, "stac_extensions": extensions}
    return {**item, "properties": {**item.get("properties", {}), **stated}, "stac_extensions": extensions}
