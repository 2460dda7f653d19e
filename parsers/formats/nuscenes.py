"""nuScenes' ``calibrated_sensor.json``: the cameras of every vehicle's calibration, among its other sensors.

In the format's own words::

    [{"token": "75ad8e2a8a3f4594a13db2398430d097", "sensor_token": "ec4b5d41…", "translation": […], "rotation": […],
      "camera_intrinsic": [[1262.8, 0.0, 786.7], [0.0, 1262.8, 437.9], [0.0, 0.0, 1.0]]},
     {"token": "…", "camera_intrinsic": []}, …]

A lidar or radar has an empty matrix. "All camera images come undistorted and rectified"; their size is in another
table.

Source: nuScenes, ``docs/schema_nuscenes.md``, "calibrated_sensor".
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import ORIGIN, camera, chosen_origin, native_of
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    remarks=("undistorted images", "the origin is not stated"),
)
MAX_SENSORS = 50_000


def sniff(content: Content) -> Sniff | None:
    """A list whose items have a camera_intrinsic and a sensor_token."""
    document = content.json
    first = document[0] if isinstance(document, list) and document else None
    if isinstance(first, dict) and {"camera_intrinsic", "sensor_token"} <= first.keys():
        return Sniff(Sure.MAGIC, "a JSON list of sensors with camera_intrinsic and sensor_token")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, by its token."""
    document = loaded(data, context)
    items = document.items()
    if len(items) > MAX_SENSORS:
        document.fail(f"{len(items)} sensors, expected at most {MAX_SENSORS}")
    nodes = [item for item in items if item["camera_intrinsic"].value != []]
    origin, sentence = chosen_origin(context, CONVENTION.origin)
    convention = replace(CONVENTION, origin=origin)
    found: dict[str, Calibration] = {}
    for item in nodes:
        token = item["token"].text()
        if token in found:
            item["token"].fail("it is a duplicate token")
        native = native_of(item["camera_intrinsic"])
        name = token if len(nodes) > 1 else None
        found[token] = camera(
            context, convention, native, None, NoDistortion(), name=name, tag=token, assumptions=(sentence,)
        )
    return list(found.values())


FORMAT = Format(
    name="nuscenes",
    title="nuScenes calibrated_sensor.json",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://www.nuscenes.org/nuscenes#data-format",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
    options=(ORIGIN,),
)
