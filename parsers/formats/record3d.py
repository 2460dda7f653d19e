"""Record3D's ``metadata.json``: the camera of an iPhone's or iPad's recording with depth.

In the format's own words::

    {"w": 1440, "h": 1920, "dw": 192, "dh": 256, "fps": 60,
     "K": [1347.6, 0, 0, 0, 1347.6, 0, 720.2, 965.7, 1],
     "perFrameIntrinsicCoeffs": [[1347.6, 1347.6, 720.2, 965.7], …], "poses": […]}

K runs down the columns. ARKit's autofocus changes it from frame to frame; calibrary reads the file's own K and reports
how far the frames differ from it. Apple counts from the top-left corner of the image. The phone rectifies the images to
an unknown degree, so the distortion is not stated.

Sources: Record3D, "Exported metadata", whose program is closed; nerfstudio, ``process_data/record3d_utils.py``, which
transposes K and puts the principal point into the middle; Apple, "ARCamera.intrinsics".
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import camera, native_of
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.CORNER,
    tangential=Tangential.NONE,
    remarks=("K runs down the columns", "the distortion is not stated"),
)
MAX_FRAMES = 100_000
CORNER = (
    "Apple counts from the top-left corner of the image, which was taken for the first pixel's outer corner"
)


def sniff(content: Content) -> Sniff | None:
    """K beside the sizes of image and depth map."""
    if {"K", "w", "h"} <= set(content.json_keys) and {"dw", "perFrameIntrinsicCoeffs", "poses"} & set(
        content.json_keys
    ):
        return Sniff(Sure.MAGIC, "JSON with K, w, h and Record3D's frames")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera."""
    document = loaded(data, context)
    native = native_of(document["K"], transposed=True)
    item = camera(
        context, CONVENTION, native, document.image_size("w", "h"), None, tag="K", assumptions=(CORNER,)
    )
    frames = document.get("perFrameIntrinsicCoeffs")
    return [item if frames is None else replace(item, notes=(*item.notes, *_spread(frames, native.fx)))]


def _spread(frames: Node, fx: float) -> tuple[str, ...]:
    rows = frames.items()
    if len(rows) > MAX_FRAMES:
        frames.fail(f"{len(rows)} frames, expected at most {MAX_FRAMES}")
    focals = [row.numbers(4)[0] for row in rows]
    if not focals or (min(focals) == fx == max(focals)):
        return ()
    return (
        f"the focal length of the {len(focals)} frames is {min(focals):.5g} to {max(focals):.5g} px; K has {fx:.5g}",
    )


FORMAT = Format(
    name="record3d",
    title="Record3D metadata.json",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://record3d.app/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
