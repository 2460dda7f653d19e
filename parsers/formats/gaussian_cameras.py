"""``cameras.json`` of 3D Gaussian splatting: the undistorted camera of every image of a scene.

In the format's own words::

    [{"id": 0, "img_name": "00001", "width": 1959, "height": 1090, "position": […], "rotation": […],
      "fy": 1164.6, "fx": 1159.5}, …]

The training's images are undistorted and their principal point in the middle: it goes by the field of view alone.
Images whose numbers are the same are one camera.

Source: gaussian-splatting, ``utils/camera_utils.py``, ``camera_to_JSON``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import camera
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.IMAGE_CENTRE,
    tangential=Tangential.NONE,
    remarks=("undistorted images; the principal point is in the middle",),
)
MIDDLE = "the file has no principal point; the program renders with it in the middle of the image"
KEYS = frozenset({"img_name", "width", "height", "fx", "fy", "rotation"})
MAX_IMAGES = 1_000_000


def sniff(content: Content) -> Sniff | None:
    """A list whose first item has the program's keys."""
    document = content.json
    first = document[0] if isinstance(document, list) and document else None
    if isinstance(first, dict) and first.keys() >= KEYS:
        return Sniff(Sure.MAGIC, "a JSON list of images with img_name, fx, fy and rotation")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that differs, in the order of the images, by the name of its first image."""
    document = loaded(data, context)
    items = document.items()
    if len(items) > MAX_IMAGES:
        document.fail(f"{len(items)} images, expected at most {MAX_IMAGES}")
    names: dict[tuple[tuple[int, int], float, float], str] = {}
    for item in items:
        numbers = (item.image_size("width", "height"), item["fx"].number(), item["fy"].number())
        names.setdefault(numbers, str(item["img_name"].value))
    several = len(names) > 1
    return [
        replace(
            camera(
                context,
                CONVENTION,
                Native(fx=fx, fy=fy, cx=0.0, cy=0.0),
                size,
                NoDistortion(),
                name=name if several else None,
                tag=name,
                assumptions=(MIDDLE,),
            ),
            grade=Grade.ADJUSTED,
        )
        for (size, fx, fy), name in names.items()
    ]


FORMAT = Format(
    name="gaussian_cameras",
    title="3D Gaussian splatting cameras.json",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/graphdeco-inria/gaussian-splatting",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
