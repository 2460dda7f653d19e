"""``cameras_sphere.npz`` and ``cameras.npz`` of IDR, NeuS and their descendants: a projection matrix for each image.

In the format's own words::

    world_mat_0   4×4    K·[R | t] in its first three rows, for pixels
    scale_mat_0   4×4    takes the unit sphere to the object
    world_mat_1 …

calibrary decomposes each matrix into K, as the programs do with ``cv2.decomposeProjectionMatrix``; images whose K agree
are one camera. Pixels are counted by whole numbers, 0 being the first. ``camera_mat_0``, if it is there, is no K. The
file states neither image size nor distortion.

Sources: IDR, ``code/utils/rend_util.py``, ``load_K_Rt_from_P``; NeuS, ``models/dataset.py``, ``gen_rays_at``.
"""

from __future__ import annotations

import re

import numpy as np

from calibrary.calibration import Calibration, Grade
from calibrary.errors import ParseError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN, camera
from calibrary.parsers.formats._tree import arrays, names_of_arrays
from calibrary.parsers.formats.projection_matrix import SMALLEST_FOCAL_PX, upper_triangle
from calibrary.quality import Quality
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    remarks=("K comes from an RQ decomposition; the file contains no distortion and no image size",),
)
EQUAL_PX = 0.01
"""K of single-precision matrices differ by less from image to image."""
_WORLD = re.compile(r"world_mat_\d{1,7}")


def sniff(content: Content) -> Sniff | None:
    """A zip of arrays with a world_mat_0 and a scale_mat_0."""
    names = names_of_arrays(content.data)
    if any(_WORLD.fullmatch(name) for name in names) and any(name.startswith("scale_mat_") for name in names):
        return Sniff(Sure.MAGIC, "a zip archive of numpy arrays with world_mat_0 and scale_mat_0")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that differs, in the order of the images."""
    tree = Node(arrays(data), source=context.name)
    images: list[tuple[np.ndarray[tuple[int, ...], np.dtype[np.float64]], list[str]]] = []
    for name, node in tree.entries():
        if not _WORLD.fullmatch(name):
            continue
        K = upper_triangle(np.array(node.matrix(4, 4))[:3, :3])
        if not min(K[0, 0], K[1, 1]) >= SMALLEST_FOCAL_PX:
            raise ParseError(
                "it decomposes into focal lengths that are not in px, expected K·[R | t]", place=name
            )
        one = next((names for known, names in images if np.abs(known - K).max() < EQUAL_PX), None)
        if one is None:
            images.append((K, [name]))
        else:
            one.append(name)
    if not images:
        raise ParseError("there is no world_mat_0")
    several = len(images) > 1
    return [
        replace(
            camera(
                context,
                CONVENTION,
                Native(
                    fx=float(K[0, 0]),
                    fy=float(K[1, 1]),
                    cx=float(K[0, 2]),
                    cy=float(K[1, 2]),
                    skew=0.0 if abs(K[0, 1]) < EQUAL_PX else float(K[0, 1]),
                ),
                None,
                None,
                name=names[0] if several else None,
                tag=names[0],
                assumptions=(ORIGIN_UNKNOWN,),
            ),
            grade=Grade.DERIVED,
            quality=Quality(views=len(names)),
        )
        for K, names in images
    ]


FORMAT = Format(
    name="neus_npz",
    title="NeuS and IDR cameras (cameras_sphere.npz)",
    suffixes=(".npz",),
    syntaxes=(Syntax.BINARY,),
    reference="https://github.com/lioryariv/idr/blob/main/DATA_CONVENTION.md",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
)
