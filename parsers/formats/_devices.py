"""Rows of the table of programs' formats: what a camera's maker keeps in it or exports from it.

To add one, add its row, and its sample with the formula computed independently to the tests of the formats.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Sequence
from typing import Final

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import (
    Distortion,
    InverseBrown,
)
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential, Unit
from calibrary.parsers.document import Node, accounted
from calibrary.parsers.format import Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._lenses import (
    BROWN5,
    COUNTS,
    FISHEYE4,
    OPENCV_ORDER,
    field_of_view,
    fisheye,
    lens,
    smallest_lens,
)
from calibrary.parsers.formats._one_camera import refuse_model
from calibrary.parsers.formats._table import (
    FOUR,
    K4,
    UNKNOWN_LENS,
    Mark,
    Model,
    Named,
    Program,
    at,
    find,
    noted,
    with_more,
)
from calibrary.parsers.formats._text_rows import keyed, rows_of
from calibrary.records import Json, replace


def _depthai_cameras(tree: Node, _context: ReadContext) -> Named:
    """Every camera that has been calibrated, by its socket: C++'s JSON writes a map by number as a list of pairs."""
    if "cameraData" not in tree:
        yield None, tree
        return
    table = tree["cameraData"]
    pairs = table.entries() if isinstance(table.value, dict) else map(_pair, table.items())
    found = [(socket, node) for socket, node in pairs if _is_calibrated(node)]
    if not found:
        table.fail("it contains no camera with an intrinsicMatrix: the device is not calibrated")
    for socket, node in found:
        is_number = socket.isascii() and socket.isdigit() and int(socket) < 26
        yield f"CAM_{chr(ord('A') + int(socket))}" if is_number else socket, node


def _pair(item: Node) -> tuple[str, Node]:
    pair = item.items()
    if len(pair) != 2:
        item.fail(f"{len(pair)} values, expected a socket and a camera")
    return str(pair[0].value), pair[1]


def _is_calibrated(node: Node) -> bool:
    matrix = find(node, "intrinsicMatrix")
    return matrix is not None and bool(matrix.value) and matrix.items()[0].value != [0, 0, 0]


def _depthai(tree: Node, _node: Node, item: Calibration) -> Calibration:
    model = find(tree, "productName|boardName") if "cameraData" in tree else None
    if model is None or not model.text():
        return item
    return replace(item, camera=replace(item.camera, make="Luxonis", model=model.text()))


def _first_four(values: Sequence[float]) -> Distortion:
    numbers = list(values)
    if len(numbers) < 4 or any(numbers[4:]):
        raise ParseError("expected a fisheye's four coefficients and zeros after them")
    return fisheye(numbers[:4])


def _kinect_lens(values: Sequence[float]) -> Distortion:
    k1, k2, k3, k4, k5, k6, codx, cody, p2, p1 = values
    if codx or cody:
        raise UnsupportedModelError("the distortion has a centre of its own, which has no counterpart here")
    return lens((k1, k2, p1, p2, k3, k4, k5, k6))


def _record3d(tree: Node, _node: Node, item: Calibration) -> Calibration:
    """How far the frames, whose focus changes, differ from K."""
    frames, fx = find(tree, "perFrameIntrinsicCoeffs"), item.intrinsics.fx
    focals = [row.numbers(4)[0] for row in frames.items()] if frames is not None else []
    if not focals or (min(focals) == fx == max(focals)):
        return item
    spread = f"{min(focals):.5g} to {max(focals):.5g} px; K has {fx:.5g}"
    return noted(item, f"the focal length of the {len(focals)} frames is {spread}")


ZED_SIZES: Final[dict[str, ImageSize]] = {
    "2K": (2208, 1242),
    "FHD": (1920, 1080),
    "HD": (1280, 720),
    "VGA": (672, 376),
    "FHD1200": (1920, 1200),
    "SVGA": (960, 600),
    "QHDPLUS": (3200, 1800),
    "4K": (3840, 2160),
}
"""What the names of the resolutions stand for, in px."""
ZED_LENS = OPENCV_ORDER[:8]
ZED_RAW = (
    "this is the camera of the raw images; those that the ZED SDK hands out are rectified and need another K"
)
_ZED = re.compile(r"(LEFT|RIGHT)_CAM_(\w+)", re.IGNORECASE)


def _is_zed(content: Content) -> Sniff | None:
    section = next((line for line in content.lines if line[:1] == "[" and _ZED.fullmatch(line[1:-1])), None)
    return Sniff(Sure.MAGIC, f"the section {section}") if section else None


def _zed_cameras(tree: Node, context: ReadContext) -> Named:
    """Every camera at every resolution; with ``image_size`` those of that size alone."""
    sections = {name.upper(): node for name, node in tree.entries()}
    found = [(node, match) for name, node in sections.items() if (match := _ZED.fullmatch(name))]
    if not found:
        tree.fail("there is no section [LEFT_CAM_…]")
    _refuse_part_of_a_lens(*list(sections.items())[-1])
    sized = [(node, match[1], ZED_SIZES.get(match[2])) for node, match in found]
    known = [(node, side, size) for node, side, size in sized if size is not None]
    wanted = [one for one in known if context.image_size in {None, one[2]}]
    if not wanted:
        sizes = (
            ", ".join(f"{w}×{h}" for w, h in dict.fromkeys(size for *_, size in known))
            or "none that is known"
        )
        raise InputError(
            f"it has no camera of the size asked for; its sizes are {sizes}", source=context.name
        )
    left_out = ", ".join(str(node.place) for node, _, size in sized if size is None)
    for node, side, size in wanted:
        shared = node if "k1" in node else sections.get(f"{side}_DISTO", node)
        shared["k1"].number()
        lens: dict[str, Json] = {key: shared[key].value for key in ZED_LENS if key in shared}
        is_fisheye = "k4" in lens and not lens.keys() & {"p1", "p2", "k5", "k6"}
        kind = "fisheye" if is_fisheye else "pinhole"
        yield str(node.place), with_more(node, {**lens, "size": [*size], "kind": kind, "left out": left_out})


def _refuse_part_of_a_lens(name: str, node: Node) -> None:
    """What ends the file in the middle of its coefficients was cut short; as a rule [STEREO] follows."""
    keys = node.keys()
    if name.endswith("_DISTO"):
        whole = "k6" in keys or ("k4" in keys and "p1" not in keys)
    else:
        whole = "k1" not in keys or "k3" in keys
    if not whole:
        node.fail(f"the file ends after {', '.join(keys) or 'its name'}, so it may be cut short; complete it")


def _zed(_tree: Node, node: Node, item: Calibration) -> Calibration:
    left_out = node["left out"].text()
    more = (f"{left_out} are left out: the size of their images is not known",) if left_out else ()
    return noted(item, ZED_RAW, *more)


INVERSE_BROWN = Option(
    name="inverse_brown",
    values=("distorted-to-undistorted", "undistorted-to-distorted"),
    meaning="which way Inverse Brown Conrady maps: as it is documented, or as newer versions of rsutil.h use it",
)
RS_SHAPE = frozenset({"ppx", "ppy", "fx", "fy"})
RS_KEYS = {
    "Width": "width", "Height": "height", "PPX": "ppx", "PPY": "ppy", "Fx": "fx", "Fy": "fy", "Distortion": "model",
    "Coeffs": "coeffs",
}  # fmt: skip
"""As they are printed, and the fields that they are of."""
RS_UNNAMED = "the file names no model, so Brown Conrady was taken, with librealsense's order k1 k2 p1 p2 k3"
RS_RECTIFIED = (
    "this is the camera of the rectified images; the raw imagers (intrinsic_left, intrinsic_right) are "
    "given in fractions of a size that the table does not state, and are left out"
)
_PRINTED = re.compile(r'Intrinsics? of "([^"]{1,60})" / (\d+x\d+)')
_RECTIFIED = re.compile(r"rectified\.(\d+)\.fx")


def _is_realsense(content: Content) -> Sniff | None:
    """The key rectified.0.fx, an object with fx, fy, ppx, ppy, or a printed stream."""
    if content.syntax is Syntax.TEXT:
        is_printed = "PPX:" in (content.text or "") and any(_PRINTED.match(line) for line in content.lines)
        return Sniff(Sure.MAGIC, "a line Intrinsic of, and PPX") if is_printed else None
    table = next((key for key in content.json_keys if _RECTIFIED.fullmatch(key)), None)
    if table:
        return Sniff(Sure.MAGIC, f"the key {table}")
    if next(_streams(content.json), None) is not None:
        return Sniff(Sure.MAGIC, "an object with the keys fx, fy, ppx and ppy")
    return None


def _realsense(data: bytes, context: ReadContext) -> Node:
    if data.removeprefix(BOM_UTF8).lstrip().startswith((b"{", b"[")):
        return loaded(data, context)
    return Node(_printed(data, context.name), source=context.name)


@accounted
def _printed(data: bytes, source: str) -> dict[str, Json]:
    """The streams that rs-enumerate-devices prints, by name and size, under the keys of rs2_intrinsics."""
    streams: dict[str, dict[str, Json]] = {}
    table: dict[str, Json] = {}
    for row in rows_of(data, source=source):
        if heading := _PRINTED.match(row.strip()):
            table = streams[f"{heading[1]} {heading[2]}"] = {}
        key, mark, value = (part.strip() for part in row.partition(":"))
        if mark and key in RS_KEYS:
            table[RS_KEYS[key]] = [*map(strict.number, value.split())] if key == "Coeffs" else value
        elif not row.strip():
            table = {}
    return {name: found for name, found in streams.items() if found.keys() >= RS_SHAPE}


def _streams(value: Json) -> Iterator[tuple[str, Json]]:
    """The objects that are intrinsics, by name: the document itself, its items, or what its keys hold."""
    if isinstance(value, dict) and value.keys() >= RS_SHAPE:
        yield "", value
        return
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inner:
        if isinstance(item, dict) and item.keys() >= RS_SHAPE:
            yield key if isinstance(key, str) else f"[{key}]", item


def _realsense_cameras(tree: Node, context: ReadContext) -> Named:
    """Every stream, or the rectified camera of every resolution; with ``image_size`` of that alone."""
    keys = [*tree.value] if isinstance(tree.value, dict) else []
    if numbers := [match[1] for key in keys if (match := _RECTIFIED.fullmatch(key))]:
        yield from _rectified(tree, numbers, context)
        return
    streams = list(_streams(tree.value))
    if not streams:
        tree.fail("there is neither a rectified.0.fx nor an object with fx, fy, ppx and ppy")
    for name, value in streams:
        node = Node(value, source=tree.source, place=name or None)
        yield name, with_more(node, {"kind": _stream_kind(node, context)})


def _rectified(tree: Node, numbers: Sequence[str], context: ReadContext) -> Named:
    filled: dict[ImageSize, Node] = {}
    for number in numbers:
        place = f"rectified.{number}"
        own = {key: tree[f"{place}.{key}"].number() for key in (*RS_SHAPE, "width", "height")}
        if own["width"] and own["height"]:
            size = strict.image_size(own["width"], own["height"], source=tree.source, place=place)
            filled.setdefault(size, Node({**own, "kind": "rectified"}, source=tree.source, place=place))
    wanted = [size for size in filled if context.image_size in {None, size}]
    if not wanted:
        sizes = ", ".join(f"{w}×{h}" for w, h in filled) or "none"
        raise InputError(
            f"the table has no rectified camera of the size asked for; its sizes are {sizes}",
            source=tree.source,
        )
    yield from ((f"rectified {size[0]}x{size[1]}", filled[size]) for size in wanted)


def _stream_kind(node: Node, context: ReadContext) -> str:
    """The lens of a stream: librealsense's name in lower case without anything between the words, and its direction."""
    coefficients, model = find(node, RS_LENS), find(node, "model")
    values = storage.numbers(coefficients) if coefficients is not None else ()
    if model is None:
        return "unnamed" if len(values) == len(BROWN5) else ""
    kind = re.sub(r"rs2_distortion_|distortion\.|[^a-z0-9]", "", model.text().lower())
    if kind not in RS_KINDS:
        refuse_model(model.text(), RS_KINDS, place=model.place)
    if not any(values):
        return "none"
    if kind == "none":
        model.fail("there are coefficients of a model that has none")
    if kind == "modifiedbrownconrady" and any(values[2:4]):
        # Tangential terms of the point that is radially distorted already: without them, Brown's model.
        raise UnsupportedModelError(
            "Modified Brown Conrady with tangential terms has no counterpart here; ask the camera for rectified "
            "images, or calibrate it from photographs of a board",
            source=model.source,
            place=model.place,
        )
    asked = context.option(INVERSE_BROWN.name)
    if kind == "inversebrownconrady" and asked is None:
        model.fail(
            "Inverse Brown Conrady is documented to map distorted to undistorted points, newer librealsense inverts "
            "the same polynomial; say which with --set inverse_brown=distorted-to-undistorted or "
            "inverse_brown=undistorted-to-distorted"
        )
    return "brownconrady" if kind == "inversebrownconrady" and asked != INVERSE_BROWN.values[0] else kind


def _inverse_brown(values: Sequence[float]) -> Distortion:
    k1, k2, p1, p2, k3 = (*values, 0.0)[:5]
    return InverseBrown(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)


RS_LENS = "coeffs|coefficients"
RS_KINDS = ("none", "brownconrady", "modifiedbrownconrady", "inversebrownconrady", "kannalabrandt4", "ftheta")
RS_MODELS = {
    "none": Model(),
    "brownconrady": Model(lens, (RS_LENS,), (4, 5)),
    "modifiedbrownconrady": Model(lens, (RS_LENS,), (4, 5)),
    "inversebrownconrady": Model(_inverse_brown, (RS_LENS,), (4, 5)),
    "kannalabrandt4": Model(lambda values: fisheye(values[:4]), (RS_LENS,), (4, 5)),
    "ftheta": Model(lambda values: field_of_view(values[:1]), (RS_LENS,), (4, 5)),
    "rectified": Model(),
    "unnamed": Model(lens, (RS_LENS,)),
    "": Model(lambda _: None),
}


def _realsense_noted(tree: Node, node: Node, item: Calibration) -> Calibration:
    kind = node["kind"].value
    if kind == "rectified" and "intrinsic_left.x.x" in tree:
        return noted(item, RS_RECTIFIED)
    return noted(item, RS_UNNAMED) if kind == "unnamed" else item


ROWS: Final = (
    Program(
        name="azure_kinect",
        title="Azure Kinect calibration",
        words="""\
Azure Kinect's factory calibration, the JSON inside the camera and its recordings.

In the format's own words::

    {"CalibrationInformation": {"Cameras": [
        {"Intrinsics": {"ModelType": "CALIBRATION_LensDistortionModelBrownConrady", "ModelParameterCount": 14,
                        "ModelParameters": [cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, codx, cody, p2, p1]},
         "Location": "CALIBRATION_CameraLocationPV0", "SensorWidth": 4096, "SensorHeight": 3072}, …]}}

cx and fx are fractions of the sensor's width, cy and fy of its height, and the SDK takes half a pixel off cx·width:
they count from the corner of the first pixel. The lens is OpenCV's rational model, p2 before p1. K is of the whole
sensor. The colour camera's 4:3 modes are scaled, its 16:9 modes are also cropped above and below, and the depth
camera's modes are binned and cropped.

Sources: Azure-Kinect-Sensor-SDK, ``src/calibration/calibration.c``, ``src/transformation/mode_specific_calibration.c``
and ``examples/opencv_compatibility``.
""",
        suffixes=(".json",),
        reference="https://microsoft.github.io/Azure-Kinect-Sensor-SDK/master/index.html",
        convention=Convention(
            unit=Unit.EACH_SIDE,
            origin=Origin.CORNER,
            coefficients=("k1", "k2", "k3", "k4", "k5", "k6", "p2", "p1"),
            remarks=("the principal point comes before the focal lengths", "K is of the whole sensor"),
        ),
        marks=(Mark(("CalibrationInformation",)),),
        cameras=lambda tree, _: (
            (node["Location"].text().removeprefix("CALIBRATION_CameraLocation"), node)
            for node in at(tree, "CalibrationInformation.Cameras").items()
        ),
        K=("Intrinsics.ModelParameters[2:4]", "Intrinsics.ModelParameters[0:2]"),
        size=("SensorWidth", "SensorHeight"),
        model=("Intrinsics.ModelType",),
        models={
            "CALIBRATION_LensDistortionModelBrownConrady": Model(
                _kinect_lens, ("Intrinsics.ModelParameters[4:]",), (10,)
            )
        },
        assumptions=("K is of the whole sensor; the modes of the camera scale and cut its images",),
    ),
    Program(
        name="depthai",
        title="Luxonis DepthAI (OAK) calibration",
        words="""\
Luxonis OAK cameras: the calibration that DepthAI keeps in the camera's EEPROM, as JSON.

In the format's own words::

    {"productName": "OAK-D", "boardName": "BW1098OBC",
     "cameraData": [[2, {"cameraType": 0,                    0 perspective, 1 fisheye
                         "intrinsicMatrix": [[799.7, 0, 662.9], [0, 799.4, 382.2], [0, 0, 1]],
                         "distortionCoeff": […],             14, in OpenCV's order; a fisheye's first four
                         "width": 1280, "height": 720, …}]], …}

A camera's number is its socket: 0 is CAM_A (colour), 1 CAM_B (left), 2 CAM_C (right). A file may also contain one
camera of the table alone. The coefficients are OpenCV's rational model, whose numerator and denominator nearly cancel
here: values beyond 100 are usual and harmless.

Source: Luxonis, depthai-core, ``EepromData.hpp``, ``CameraInfo.hpp``.
""",
        suffixes=(".json",),
        reference="https://docs.luxonis.com/hardware/platform/depth/calibration/",
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER, remarks=(FOUR,)),
        marks=(Mark(("cameraData",)), Mark(("intrinsicMatrix", "distortionCoeff"), sure=Sure.SHAPE)),
        cameras=_depthai_cameras,
        K="intrinsicMatrix",
        model=("cameraType",),
        models={
            "": Model(smallest_lens, ("distortionCoeff",), COUNTS),
            "0": Model(smallest_lens, ("distortionCoeff",), COUNTS),
            "1": Model(_first_four, ("distortionCoeff",)),
        },
        finish=_depthai,
    ),
    Program(
        name="polycam",
        title="Polycam camera",
        words="""\
Polycam's cameras: JSON of fx, fy, cx, cy and a pose, one file for each image.

In the format's own words::

    {"fx": 1360.2, "fy": 1360.2, "cx": 514.9, "cy": 385.3, "width": 1024, "height": 768, "t_00": 0.7, …}

The numbers are ARKit's, which count from the corner of the image. The images are not corrected, and no distortion is
stated.

Sources: Polycam, "Raw data export", whose program is closed; nerfstudio, ``process_data/polycam_utils.py``, which
copies the numbers unchanged to a transforms.json, and ``cameras/cameras.py``, ``get_image_coords``, which has the
pixels' centres at 0.5, 1.5, … of it.
""",
        suffixes=(".json",),
        reference="https://github.com/PolyCam/polyform",
        convention=Convention(
            origin=Origin.CORNER,
            remarks=("every number has its name",),
        ),
        marks=(Mark((*K4, "t_00", "t_01")),),
        K=K4,
        asks_origin=True,
        models=UNKNOWN_LENS,
    ),
    Program(
        name="realsense",
        title="Intel RealSense intrinsics",
        words="""\
Intel RealSense: the calibration table of a depth camera, and intrinsics as librealsense names them.

In the formats' own words::

    {"baseline": -50.06,
     "intrinsic_left.x.x": 0.497071, …                                the raw left imager, normalised
     "rectified.0.width": 1920, "rectified.0.height": 1080,
     "rectified.0.fx": 957.2, "rectified.0.fy": 957.2, "rectified.0.ppx": 971.8, "rectified.0.ppy": 527.8, …}

    {"width": 1280, "height": 720, "fx": 638.1, "fy": 638.1, "ppx": 647.9, "ppy": 351.9,
     "model": "Brown Conrady", "coeffs": [0, 0, 0, 0, 0]}              k1 k2 p1 p2 k3

    Intrinsic of "Color" / 1280x720 / {YUYV/RGB8/…}
      Width: 1280   Height: 720   PPX: 641.5   PPY: 363.3   Fx: 911.3   Fy: 910.7                  a line each
      Distortion: Inverse Brown Conrady
      Coeffs: 0.1312  -0.2811  0.0007  -0.0004  0.1203

The first is what the D400 series' tools export. The camera rectifies its images before it hands them out, so
``rectified`` is the camera of those images at each resolution. The second is ``rs2_intrinsics``, alone, in a list, or
several by the names of their streams. The third is what ``rs-enumerate-devices -c`` prints, each stream at each of its
sizes. (0, 0) is the centre of the top-left pixel.

``Inverse Brown Conrady`` is documented to undistort; librealsense once did that in closed form and now inverts the
same polynomial as if it distorted, so files with coefficients other than zero leave it open which is meant.

Source: librealsense, ``rs_types.h``, ``rsutil.h`` and "Projection in RealSense SDK 2.0".
""",
        suffixes=(".json", ".txt"),
        reference="https://dev.intelrealsense.com/docs/projection-in-intel-realsense-sdk-20",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=BROWN5,
            remarks=("the calibration table's rectified cameras are read, because the images are rectified",),
        ),
        recognise=_is_realsense,
        load=_realsense,
        cameras=_realsense_cameras,
        K=("fx", "fy", "ppx", "ppy"),
        model=("kind",),
        models=RS_MODELS,
        finish=_realsense_noted,
        options=(INVERSE_BROWN,),
    ),
    Program(
        name="record3d",
        title="Record3D metadata.json",
        words="""\
Record3D's ``metadata.json``: the camera of an iPhone's or iPad's recording with depth.

In the format's own words::

    {"w": 1440, "h": 1920, "dw": 192, "dh": 256, "fps": 60,
     "K": [1347.6, 0, 0, 0, 1347.6, 0, 720.2, 965.7, 1],
     "perFrameIntrinsicCoeffs": [[1347.6, 1347.6, 720.2, 965.7], …], "poses": […]}

K runs down the columns. ARKit's autofocus changes it from frame to frame; calibrary reads the file's own K and reports
how far the frames differ from it. Apple counts from the top-left corner of the image. The phone rectifies the images to
an unknown degree, so the distortion is not stated.

Sources: Record3D, "Exported metadata", whose program is closed; nerfstudio, ``process_data/record3d_utils.py``, which
transposes K and puts the principal point into the middle; Apple, "ARCamera.intrinsics".
""",
        suffixes=(".json",),
        reference="https://record3d.app/",
        convention=Convention(
            origin=Origin.CORNER,
            tangential=Tangential.NONE,
            remarks=("K runs down the columns", "the distortion is not stated"),
        ),
        marks=tuple(Mark(("K", "w", "h", key)) for key in ("dw", "perFrameIntrinsicCoeffs", "poses")),
        K="K",
        is_transposed=True,
        size=("w", "h"),
        models={"": Model(lambda _: None)},
        assumptions=(
            "Apple counts from the top-left corner of the image, which was taken for the first pixel's outer corner",
        ),
        finish=_record3d,
    ),
    Program(
        name="zed",
        title="Stereolabs ZED factory calibration",
        words="""\
Stereolabs' ZED factory calibration, ``SN*.conf``: both cameras at every resolution.

In the format's own words::

    [LEFT_CAM_FHD]
    fx=1068.5
    fy=1068.1
    cx=960.1
    cy=540.0
    k1=-0.0592                  older files: k1, k2, p1, p2, k3 here
    …
    [LEFT_DISTO]                newer files: k1, k2, p1, p2, k3, k4, k5, k6 for all resolutions
    …                           (k1, k2, k3, k4 alone: OpenCV's fisheye)
    [STEREO]
    Baseline=120.1

The numbers are of the images as they were taken, not of the rectified ones that the ZED SDK hands out. The file does
not state the size of the images; it follows from the name of the resolution.

Source: Stereolabs, ``zed-open-capture`` (reads them) and ``zed-opencv-calibration`` (writes them).
""",
        suffixes=(".conf", ".ini"),
        reference="https://github.com/stereolabs/zed-open-capture",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            remarks=("coefficients are named, k4 to k6 divide", "k1 to k4 without p1 are a fisheye's"),
        ),
        recognise=_is_zed,
        load=lambda data, context: keyed(data, context.name, comments="#;"),
        cameras=_zed_cameras,
        K=K4,
        size=("size",),
        model=("kind",),
        models={
            "fisheye": Model(fisheye, FISHEYE4),
            "pinhole": Model(smallest_lens, ZED_LENS, missing=0.0),
        },
        is_always_named=True,
        finish=_zed,
        idle=("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"),
    ),
)
"""In alphabetical order."""
