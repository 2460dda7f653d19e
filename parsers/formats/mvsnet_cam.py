"""MVSNet's ``_cam.txt``, one for each image, which its many descendants and BlendedMVS share.

In the format's own words::

    extrinsic
    0.970 0.007 0.241 -191.0
    …
    0.0 0.0 0.0 1.0

    intrinsic
    2892.33 0 823.205
    0 2883.18 619.071
    0 0 1

    425 2.5                        nearest depth, interval (number, farthest)

The images are undistorted; the file does not state their size. MVSNet counts from the corner of the image: its
converter copies COLMAP's cx and cy unchanged, and its warping has the pixels' centres at 0.5, 1.5, … of K. Its PyTorch
descendants put them at 0, 1, … for the same files, half a pixel off; a file that was made for those is read with
``--pixel-origin centre``.

Sources: MVSNet, README "Camera files"; ``mvsnet/preprocess.py``, ``load_cam``: nine numbers behind the word intrinsic,
row by row; ``mvsnet/colmap2mvsnet.py``, which writes them; ``mvsnet/homography_warping.py``, ``get_pixel_grids`` and
``interpolate``; MVSNet_pytorch, ``models/module.py``, ``homo_warping``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import ORIGIN, camera, chosen_origin, native_of
from calibrary.parsers.formats._text_rows import text_of
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.CORNER,
    tangential=Tangential.NONE,
    remarks=(
        "undistorted images",
        "the origin is MVSNet's own; its PyTorch descendants count from the pixel's centre",
    ),
)
MOST = 16_384


def sniff(content: Content) -> Sniff | None:
    """The two words, each on a line of its own."""
    if content.first_line == "extrinsic" and "intrinsic" in content.lines:
        return Sniff(Sure.MAGIC, "the lines 'extrinsic' and 'intrinsic'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera."""
    head, word, rest = text_of(data, most=MOST).partition("\nintrinsic")
    if not head.lstrip().startswith("extrinsic") or not word:
        raise ParseError("there are no lines 'extrinsic' and 'intrinsic'")
    numbers = [strict.number(part, place="intrinsic") for part in rest.split()[:9]]
    native = native_of(Node(list(numbers), source=context.name, place="intrinsic"))
    origin, sentence = chosen_origin(context, CONVENTION.origin)
    convention = replace(CONVENTION, origin=origin)
    item = camera(context, convention, native, None, NoDistortion(), tag="intrinsic", assumptions=(sentence,))
    return [replace(item, grade=Grade.ADJUSTED)]


FORMAT = Format(
    name="mvsnet_cam",
    title="MVSNet camera (_cam.txt)",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/YoYo000/MVSNet",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
    options=(ORIGIN,),
)
