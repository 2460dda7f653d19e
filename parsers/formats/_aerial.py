"""Rows of the table of programs' formats: the cameras of photogrammetry and mapping.

To add one, add its row, and its sample with the formula computed independently to the tests of the formats.
"""

from __future__ import annotations

import re
from typing import Final

from calibrary.calibration import Calibration, Grade
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content
from calibrary.parsers.convention import Convention, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats._lenses import (
    BROWN5,
    FISHEYE4,
    OPENCV_ORDER,
    fisheye,
    lens,
    smallest_lens,
)
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN, size_of
from calibrary.parsers.formats._table import (
    MOST_BYTES,
    UNKNOWN_LENS,
    Mark,
    Model,
    Named,
    Program,
    at,
    document_of,
    everywhere,
    find,
    noted,
    one_each,
    with_more,
)
from calibrary.parsers.formats._text_rows import keyed, text_of
from calibrary.records import Json, replace


def _pix4d_cameras(tree: Node, _context: ReadContext) -> Named:
    """With K in px, of lengths in mm and pixels in micrometres."""
    for node in everywhere(tree, "camera"):
        pixel, f, cx, cy = one_each(
            node, ("pixelSize", "focalLengthmm", "principalPointXmm", "principalPointYmm")
        )
        if not pixel > 0:
            node["pixelSize"].fail(f"pixels of {pixel:g} micrometres, expected positive ones")
        mm = 1000 / pixel
        yield at(node, "name").text(), with_more(node, {"fx": f * mm, "cx": cx * mm, "cy": cy * mm})


ORTHORITY_LENS = (*OPENCV_ORDER[:12], "tx", "ty")


def _orthority_cameras(tree: Node, _context: ReadContext) -> Named:
    """With K in px, of a focal length in the sensor's unit, or in widths of the image."""
    for name, node in [(None, tree)] if "im_size" in tree else tree.entries():
        width, height = size_of(node["im_size"])
        focal = node["focal_len"]
        fx, fy = focal.numbers(2) if isinstance(focal.value, list) else (focal.number(),) * 2
        sensor = find(node, "sensor_size")
        across, down = (1.0, height / width) if sensor is None else sensor.numbers(2)
        if sensor is not None and min(across, down) <= 0:
            sensor.fail("the sensor's size is not positive")
        cx, cy = (value * max(width, height) for value in one_each(node, ("cx", "cy"), missing=0.0))
        yield name, with_more(node, {"K": [fx * width / across, fy * height / down, cx, cy]})


TERRAPHOTO, TERRA_POINT = "[TerraPhoto calibration]", "PrincipalPoint(XoYoZo)"
TERRA_Y_AXIS = Option(
    name="y_axis", values=("down", "up"), meaning="which way Yo of the principal point grows in the image"
)
TERRA_LENS = (
    "the lens terms ({}) are kept as written and marked unconverted: Terrasolid does not publish their "
    "formula, so the distortion is unknown"
)


def _is_terraphoto(content: Content) -> Sniff | None:
    return Sniff(Sure.MAGIC, f"the first line is {TERRAPHOTO}") if content.first_line == TERRAPHOTO else None


def _terraphoto(tree: Node, context: ReadContext) -> Named:
    """With K in px, y down."""
    tree = tree[TERRAPHOTO[1:-1]]
    values = {key.replace(" ", ""): node.text() for key, node in tree.entries()}
    if strict.number(values.get("Panoramic", "0"), place="Panoramic"):
        raise UnsupportedModelError(
            "the images are panoramas, each pixel an angle, and no K describes them; use the images of the "
            "single cameras and their own calibrations",
            place="Panoramic",
        )
    if "PlateSize" not in values:
        raise ParseError(
            "there is no PlateSize, which says the unit of the principal point; add PlateSize= with the image "
            "size if that is in pixels"
        )
    plate = strict.numbers(values["PlateSize"], count=2, place="PlateSize")
    size = strict.numbers(values["ImageSize"], count=2, place="ImageSize") if "ImageSize" in values else None
    width, height = size or context.size(None)
    if plate != (width, height):
        raise UnsupportedModelError(
            f"the plate is {plate[0]:g}×{plate[1]:g} and the image {width:g}×{height:g}, so the principal point is "
            "not in pixels of the image; save the calibration in TerraPhoto with a plate of the image's size",
            place="PlateSize",
        )
    if TERRA_POINT not in values:
        raise ParseError(f"there is no {TERRA_POINT}, which contains the focal length")
    x, y, z = strict.numbers(values[TERRA_POINT], count=3, place=TERRA_POINT)
    asked = context.option(TERRA_Y_AXIS.name)
    if y and asked is None:
        raise ParseError(
            f"Yo is {y:g}, and the format does not say whether y grows up or down; say it with "
            "--set y_axis=up or y_axis=down",
            place=TERRA_POINT,
        )
    K: list[Json] = [abs(z), abs(z), x, -y if asked == "up" else y]
    rest: dict[str, Json] = {
        key: text for key, text in values.items() if key not in {"ImageSize", "PlateSize", TERRA_POINT}
    }
    yield None, document_of(context, K=K, size=[width, height], rest=rest)


def _terraphoto_rest(_tree: Node, node: Node, item: Calibration) -> Calibration:
    rest = {key: child.text() for key, child in node["rest"].entries()}
    terms = [
        key for key, text in rest.items() if key.startswith("LensA") and any(c in text for c in "123456789")
    ]
    extras = (
        (f"{'unconverted/' if key.startswith('Lens') else ''}{key}", text) for key, text in rest.items()
    )
    item = replace(item, extras=tuple((f"terraphoto_cal/{key}", text) for key, text in extras))
    return noted(item, TERRA_LENS.format(", ".join(terms))) if terms else item


SSK_BEGIN, SSK_END = "begin camera_parameters", "end camera_parameters"
SSK_KNOWN = {
    "camera_type": "frame",
    "media_type": "digital",
    "scanline_orientation": "4",
    "photo_coord_sys_orientation": "1",
}
"""Values of which no file shows what others mean."""
SSK_FREE = "it describes images that are free of distortion; those the camera took may not be"
SSK_LENS = "lens_distortion_flag is on, but no source describes its lens model, so the distortion is unknown"
_SSK_ROW = re.compile(r"^\s*(\w{1,60})\s*:\s*(.*?)\s*$", re.MULTILINE)


def _is_ssk(content: Content) -> Sniff | None:
    is_block = any(line.startswith(SSK_BEGIN) for line in content.lines)
    return Sniff(Sure.MAGIC, f"there is a line '{SSK_BEGIN} …'") if is_block else None


def _ssk(data: bytes, context: ReadContext) -> Node:
    blocks: list[Json] = []
    for number, block in enumerate(text_of(data).split(SSK_BEGIN)[1:], start=1):
        name, _, text = block.partition("\n")
        name = name.strip() or f"camera {number}"
        body, end, _ = text.partition(SSK_END)
        if not end:
            raise ParseError(f"there is no '{SSK_END}'", place=name)
        rows: dict[str, Json] = {}
        for key, value in _SSK_ROW.findall(body):
            if rows.setdefault(key, value) is not value:
                raise ParseError(f"{key} is a duplicate key", place=name)
        blocks.append({"name": name, **rows})
    if not blocks:
        raise ParseError(f"there is no '{SSK_BEGIN}'")
    return document_of(context, cameras=blocks)


def _ssk_cameras(tree: Node, _context: ReadContext) -> Named:
    """With K in px."""
    for block in tree["cameras"].items():
        name = block["name"].text()
        node = replace(block, place=name)
        for key, known in SSK_KNOWN.items():
            if node[key].text() != known:
                raise UnsupportedModelError(
                    f"{key} is {strict.shown(node[key].text())}; what other values than {known} mean is not known; "
                    "export the camera from the adjustment in another format",
                    place=name,
                )
        (rows, columns), (down, across), (row, column), (x, y) = (
            strict.numbers(node[key].text(), count=2, source=node.source, place=f"{name}, {key}")
            for key in ("image_size_in_pixels", "pixel_size", "photo_coord_sys_origin", "ppac")
        )
        if not (down > 0 and across > 0):
            raise ParseError("the pixel size is not positive", place=name)
        mm, flag = 1000 * node["focal_length"].number(), node["lens_distortion_flag"].text()
        K: list[Json] = [mm / across, mm / down, column + 1000 * x / across, row - 1000 * y / down]
        yield (
            name,
            with_more(node, {"K": K, "size": [columns, rows], "flag": "off" if flag == "off" else "on"}),
        )


def _ssk_noted(_tree: Node, _node: Node, item: Calibration) -> Calibration:
    return noted(item, SSK_LENS if item.distortion is None else SSK_FREE)


ROWS: Final = (
    Program(
        name="orthority",
        title="orthority interior parameters",
        words="""\
orthority's interior parameters, which simple-ortho wrote as well: a camera for orthorectification.

In the format's own words::

    Acme DMC:
        type: pinhole                       # brown, opencv, fisheye
        im_size: [640, 1152]
        focal_len: 120.0                    # or [x, y]
        sensor_size: [92.16, 165.888]       # in the focal length's unit
        cx: 0.0                             # from the middle, as a fraction of the longer side
        cy: 0.0

Without sensor_size the focal length is a fraction of the image's width. brown has k1, k2, p1, p2, k3, opencv any of
OpenCV's fourteen, with tx and ty for τx and τy, and fisheye k1 to k4 of cv2.fisheye; one that is left out is zero. The
file does not state how the numbers were determined.

Source: orthority 0.7.0, ``orthority/camera.py``, ``_get_intrinsic`` and ``OpenCVCamera``, which was run on the same
files: all four types project alike to 1e-12 px; and "Interior parameter file" of its documentation.
""",
        suffixes=(".yaml", ".yml"),
        reference="https://orthority.readthedocs.io/en/stable/",
        convention=Convention(
            origin=Origin.IMAGE_CENTRE,
            coefficients=ORTHORITY_LENS,
            remarks=(
                "lengths are in the unit of sensor_size, or the image's width without it",
                "cx and cy are fractions of the longer side, and coefficients are named",
            ),
        ),
        marks=(Mark((), inner=("type", "im_size", "focal_len")),),
        cameras=_orthority_cameras,
        K=("K",),
        size=("im_size",),
        model=("type",),
        models={
            "pinhole": Model(),
            "brown": Model(smallest_lens, BROWN5, missing=0.0),
            "opencv": Model(smallest_lens, ORTHORITY_LENS, missing=0.0),
            "fisheye": Model(fisheye, FISHEYE4, missing=0.0),
        },
        grade=Grade.DERIVED,
        assumptions=(ORIGIN_UNKNOWN,),
        idle=("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"),
    ),
    Program(
        name="pix4d_camera_database",
        title="Pix4D camera database, and its cameras (XML)",
        words="""\
Pix4D's database of cameras (``camera_database.xml``), and one camera as its editor exports it.

In the format's own words::

    <cameraModelDB> <cameras>
      <camera name="ZenmuseP1_35.0_8192x5460">
        <imageWidth>8192</imageWidth> <imageHeight>5460</imageHeight>
        <pixelSize>4.27246</pixelSize>                                         micrometres
        <focalLengthmm>35.05</focalLengthmm>
        <principalPointXmm>17.4</principalPointXmm> <principalPointYmm>11.6038</principalPointYmm>
        <lensType>perspective</lensType>
        <radialK1>-0.046957</radialK1> … <radialK3/> <tangentialT1/> <tangentialT2/>
        <cameraModelSource>internalDB</cameraModelSource>

Lengths are mm, the principal point's from the image's top-left corner, and the coefficients those of Pix4D's ``.cam``.
Most cameras are a maker's nominal values, so that a K is no more than a design; a fisheye's affine and polynomial
terms have no counterpart here.

Source: Pix4D support, "How are the internal and external camera parameters defined?"; ``pix4d_cam``.
""",
        suffixes=(".xml",),
        reference="https://support.pix4d.com/hc/en-us/articles/360035481811",
        roots=("cameraModelDB", "camera"),
        convention=Convention(
            origin=Origin.CORNER,
            coefficients=("radialK1", "radialK2", "radialK3", "tangentialT1", "tangentialT2"),
            remarks=("lengths are mm, and pixelSize micrometres",),
        ),
        marks=(Mark(("camera", "imageWidth", "pixelSize", "focalLengthmm")),),
        cameras=_pix4d_cameras,
        K=("fx", "fx", "cx", "cy"),
        size=("imageWidth", "imageHeight"),
        model=("lensType",),
        models={
            "perspective": Model(
                lens, ("radialK1", "radialK2", "tangentialT1", "tangentialT2", "radialK3"), missing=0.0
            )
        },
        grade=Grade.DESIGN,
        most=100_000,
    ),
    Program(
        name="terraphoto_cal",
        title="TerraPhoto camera calibration",
        words="""\
TerraPhoto camera calibration (Terrasolid): intrinsics and mounting of a camera in one ``.cal``.

In the format's own words::

    [TerraPhoto calibration]
    Version=20050513
    Description= left camera
    LeverArm= 0.011 -0.016 0.972
    AttitudeCorrections(HRP)= 36.3 0.4 0.0
    PlateSize= 4000 3000
    ImageSize= 4000 3000
    Orientation= TOP
    PrincipalPoint(XoYoZo)= 12.4 -7.1 3650.0
    LensModel= Function
    LensA3= …   LensA5= …   LensA7= …   LensR0= …

in any order of lines. The principal point is where the focal point lies against the middle of the image, in the unit of
PlateSize, for which pixels are recommended: |Zo| is the focal length. The documentation states neither the direction of
y nor the meaning of the lens terms. The terms are kept unchanged, and the distortion is unknown.

Source: Terrasolid, "TerraPhoto User Guide", Camera calibration file format.
""",
        suffixes=(".cal",),
        reference="https://terrasolid.com/guides/tphoto/devcameracalibrationfileformat.html",
        convention=Convention(
            origin=Origin.IMAGE_CENTRE,
            tangential=Tangential.NONE,
            remarks=(
                "the focal length is |Zo|",
                "the lens terms are kept unconverted: their formula is not published",
            ),
        ),
        recognise=_is_terraphoto,
        load=lambda data, context: keyed(data, context.name, most=MOST_BYTES),
        cameras=_terraphoto,
        K=("K",),
        size=("size",),
        models=UNKNOWN_LENS,
        assumptions=("the size of the plate is in pixels, so the principal point is too",),
        finish=_terraphoto_rest,
        options=(TERRA_Y_AXIS,),
    ),
    Program(
        name="zi_ssk",
        title="Z/I Imaging camera (.ssk)",
        words="""\
Z/I Imaging's camera file, as Pix4D exports it for ImageStation (``.ssk``).

In the format's own words, a block for each camera::

    begin camera_parameters NAME
        focal_length:               8.7602                     mm
        ppac:                       0.0279 -0.0218             mm, x to the right and y up
        ppbs:                       0 0
        film_format:                8.7552 13.1328             mm, height first
        lens_distortion_flag:       off
        camera_type:                frame
        media_type:                 digital
        pixel_size:                 2.4 2.4                    µm, of a row first
        image_size_in_pixels:       3648 5472                  rows first
        scanline_orientation:       4
        photo_coord_sys_orientation: 1
        photo_coord_sys_origin:     1823.5 2735.5              row first: the image's middle, so that the centre
    end camera_parameters                                      of the top-left pixel is (0, 0)

With the flag off the images are free of distortion: Pix4D writes this file for the images that it undistorted,
so its focal length is not that of the camera's own images.

Source: files that Pix4D exported.
""",
        suffixes=(".ssk",),
        reference="https://github.com/UTokyo-FieldPhenomics-Lab/EasyIDP",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            remarks=(
                "lengths are mm, and pixel_size micrometres",
                "pairs name the row first",
                "ppac is x to the right and y up from photo_coord_sys_origin",
                "with lens_distortion_flag off the images are free of distortion",
            ),
        ),
        recognise=_is_ssk,
        load=_ssk,
        cameras=_ssk_cameras,
        K=("K",),
        size=("size",),
        model=("flag",),
        models={"off": Model(), "on": Model(lambda _: None)},
        grade=Grade.ADJUSTED,
        finish=_ssk_noted,
    ),
)
"""In alphabetical order."""
