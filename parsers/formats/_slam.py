"""Rows of the table of programs' formats: the cameras of odometry and SLAM.

To add one, add its row, and its sample with the formula computed independently to the tests of the formats.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from typing import Final

from calibrary.calibration import Calibration, Quality
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    Division,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    FisheyePolynomial,
    KannalaBrandt,
    NoDistortion,
    Unified,
)
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content
from calibrary.parsers.convention import Convention, Origin, Unit
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._json_text import restored
from calibrary.parsers.formats._lenses import (
    BROWN5,
    COUNTS,
    FISHEYE4,
    OPENCV_ORDER,
    BrownWithoutK3,
    double_sphere,
    extended_unified,
    field_of_view,
    fisheye,
    lens,
    unified,
)
from calibrary.parsers.formats._one_camera import refuse_model
from calibrary.parsers.formats._table import (
    K4,
    MOST_BYTES,
    OF_RAY,
    Mark,
    Model,
    Named,
    Program,
    document_of,
    find,
    listed,
    noted,
    numbers_of,
    rest_of,
    taylor,
    turned,
    under,
    with_more,
    with_rest,
    with_turn,
)
from calibrary.parsers.formats._text_rows import rows_of, text_of
from calibrary.parsers.formats._yaml_text import decimal, flow, scalar
from calibrary.records import Json, replace


def _near_axis(item: Calibration, symbol: str) -> Calibration:
    """What K's focal length is of a lens that has xi."""
    lens = item.distortion
    if not isinstance(lens, Unified | DoubleSphere) or not lens.xi:
        return item
    near = item.intrinsics.fx / (1 + lens.xi)
    return noted(
        item,
        f"K's fx is {symbol}; near the axis the camera is a pinhole of {near:.6g} px, {symbol}/(1 + xi)",
    )


def _basalt_cameras(tree: Node, _context: ReadContext) -> Named:
    cameras, sizes = (tree["value0"][key].items() for key in ("intrinsics", "resolution"))
    if len(cameras) != len(sizes):
        tree["value0"]["resolution"].fail(f"{len(sizes)} resolutions of {len(cameras)} cameras")
    for index, (node, size) in enumerate(zip(cameras, sizes, strict=True)):
        yield f"cam{index}", with_more(node, {"resolution": size.value})


def _basalt(_tree: Node, node: Node, item: Calibration) -> Calibration:
    reach = find(node, "intrinsics.rpmax")
    if reach is not None and reach.number() > 0:
        item = noted(item, f"Basalt uses the lens up to the radius rpmax = {reach.number():g} only")
    return _near_axis(item, "fx")


_REFERENCE = re.compile(r"cam\d+_calib")


_SVO = re.compile(r"cam\d+")


def _camodocal_cameras(tree: Node, context: ReadContext) -> Named:
    """The camera of the file, or those of the files that VINS refers to."""
    if "model_type" in tree:
        yield None, tree
        return
    references = [key for key, _ in tree.entries() if _REFERENCE.fullmatch(key)]
    if not references:
        tree.fail("there is neither a model_type nor a cam0_calib")
    for key in references:
        name = tree[key].text()
        data = context.companion(name)
        if data is None:
            tree[key].fail(f"it refers to {strict.shown(name)}, which is not beside it; read that file")
        yield key.removesuffix("_calib"), Node(storage.load(data, source=name).value, source=name, place=name)


def _maplab_cameras(tree: Node, _context: ReadContext) -> Named:
    nodes = list(_maplab_rig(tree))
    if not nodes:
        tree.fail("there is no camera in its lists of cameras")
    yield from ((f"cam{index}", node) for index, node in enumerate(nodes))


def _maplab_rig(node: Node) -> Iterator[Node]:
    """The cameras under ``cameras``, also of rigs that are sensors among others."""
    for key in ("sensors", "ncameras", "cameras"):
        for item in node[key].items() if key in node else ():
            if key == "cameras":
                yield item["camera"]
            elif "cameras" in item:
                yield from _maplab_rig(item)


def _vikit_cameras(tree: Node, _context: ReadContext) -> Named:
    if "cam_model" in tree:
        yield None, tree
        return
    if "cam_num" not in tree:
        yield from ((key, node) for key, node in tree.entries() if _SVO.fullmatch(key))
        return
    count = tree["cam_num"].whole()
    if not 1 <= count <= MOST_OF_VIKIT:
        tree["cam_num"].fail(f"{count} cameras, expected 1 to {MOST_OF_VIKIT}")
    yield from ((f"cam_{index}", tree[f"cam_{index}"]) for index in range(count))


def _vikit(_tree: Node, node: Node, item: Calibration) -> Calibration:
    scale = find(node, "scale")
    if scale is None or scale.number() == 1:
        return item
    return noted(
        item, f"vikit shrinks the images by the file's scale, {scale.number():g}; K is of the size before"
    )


def _even_polynomial(values: Sequence[float]) -> Distortion:
    k2, k3, k4, *higher = values
    if any(higher):
        raise UnsupportedModelError(
            "the fisheye's polynomial reaches θ⁷ with even powers, which has no counterpart here; calibrate with "
            "vikit's EquidistantCamera, which is cv2.fisheye's model"
        )
    return FisheyePolynomial(k2=k2, k3=k3, k4=k4)


MOST_OF_VIKIT = 1000


VIKIT_K = ("cam_fx|A11", "cam_fy|A22", "cam_cx|u0", "cam_cy|v0")


VIKIT_POLYNOMIAL = Model(
    _even_polynomial, ("k2", "k3", "k4", "k5", "k6", "k7"), missing=0.0, K=(*VIKIT_K, "cam_skew|A12")
)


VIKIT_FOUR = ("cam_d0", "cam_d1", "cam_d2", "cam_d3")


MAPLAB_LENS = ("distortion.parameters",)


PLAIN = under("distortion_parameters", "k1 k2 p1 p2")


VINS_K = under("projection_parameters", "fx fy cx cy")


EUROC = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=BROWN5[:4],
    remarks=(
        "equidistant's four are k1, k2, k3, k4",
        "Kimera's omni has a ray's polynomial of the radius in px, from distorted to undistorted, as OCamCalib",
    ),
)


EUROC_KEYS = (
    "resolution", "camera_model", "intrinsics", "distortion_model", "distortion_coefficients", "omni_affine",
    "omni_distortion_center", "omni_pol_inv",
)  # fmt: skip


EUROC_REST = "euroc/"


def _euroc_cameras(tree: Node, _context: ReadContext) -> Named:
    tree["resolution"].numbers(2)
    if tree["camera_model"].text() == "omni":
        a, b, c = tree["omni_affine"].numbers(3)
        centre = tree["omni_distortion_center"].numbers(2)
        tree = with_turn(tree, tree["distortion_coefficients"], (1.0, c, b, a), centre, "omni_affine")
    yield None, tree


def _euroc(_tree: Node, node: Node, item: Calibration) -> Calibration:
    return turned(node, with_rest(item, node, EUROC_REST, (*EUROC_KEYS, "ray")), "Kimera's")


def _euroc_written(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """EuRoC's own keys, the resolution last; T_BS and the rest go back where the file they came from had them."""
    [item] = calibrations
    K, made = item.intrinsics, item.distortion or NoDistortion()
    native = EUROC.native(K)
    rest = {"sensor_type": json.dumps("camera")} | rest_of(item, EUROC_REST)
    rows = [f"{key}: {scalar(restored(text))}" for key, text in rest.items() if key.isidentifier()]
    kind = "equidistant" if isinstance(made, KannalaBrandt) else "radial-tangential"
    rows += [
        "camera_model: pinhole",
        f"intrinsics: {flow([native.fx, native.fy, native.cx, native.cy])}",
        f"distortion_model: {kind}",
        f"distortion_coefficients: {flow(list(made.coefficients.values()) or [0.0] * 4)}",
        f"resolution: [{K.image_size[0]}, {K.image_size[1]}]",
    ]
    return "".join(f"{row}\n" for row in rows).encode()


STELLA = Convention(
    origin=Origin.PIXEL_CENTRE, remarks=("coefficients are named; fisheye's four are k1, k2, k3, k4",)
)


STELLA_BLOCK, STELLA_REST = "Camera", "stella_vslam/"


STELLA_LENSES = {
    "perspective": Model(lens, BROWN5),
    "fisheye": Model(fisheye, FISHEYE4),
    "radial_division": Model(
        lambda values: Division(k=values[0]) if values[0] else NoDistortion(), ("distortion",)
    ),
}


STELLA_KEYS = {
    "model",
    *K4,
    "cols",
    "rows",
    *(key for model in STELLA_LENSES.values() for key in model.numbers),
}


STELLA_NEEDED = {"name": json.dumps("camera"), "setup": json.dumps("monocular"), "fps": "30.0"}
"""What the program does not start without; it has no bearing on the camera."""


def _stella_camera(tree: Node, _context: ReadContext) -> Named:
    flat = {
        key.removeprefix("Camera."): child.value for key, child in tree.entries() if key.startswith("Camera")
    }
    node = tree[STELLA_BLOCK] if STELLA_BLOCK in tree else Node(flat, source=tree.source, place=STELLA_BLOCK)
    if node["model"].text() == "equirectangular":
        raise UnsupportedModelError(
            "the images are equirectangular panoramas, each pixel an angle, and no K describes them",
            place=node["model"].place,
        )
    node.image_size("cols", "rows")
    yield None, node


def _stella_written(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The block Camera; the program's other blocks have defaults. The size comes last and makes it complete."""
    [item] = calibrations
    K, made = item.intrinsics, item.distortion or NoDistortion()
    native = STELLA.native(K)
    rows = [
        (key, scalar(restored(text))) for key, text in (STELLA_NEEDED | rest_of(item, STELLA_REST)).items()
    ]
    if isinstance(made, KannalaBrandt):
        model, coefficients = "fisheye", made.coefficients
    elif isinstance(made, Division):
        model, coefficients = "radial_division", {"distortion": made.k}
    else:
        model, coefficients = "perspective", {**dict.fromkeys(BROWN5, 0.0), **made.coefficients}
    rows.append(("model", json.dumps(model)))
    rows += [(key, decimal(getattr(native, key))) for key in K4]
    rows += [(key, decimal(coefficients[key])) for key in STELLA_LENSES[model].numbers]
    rows += [("cols", str(K.image_size[0])), ("rows", str(K.image_size[1]))]
    return (f"{STELLA_BLOCK}:\n" + "".join(f"  {key}: {value}\n" for key, value in rows)).encode()


IN_FRACTIONS = Convention(unit=Unit.EACH_SIDE, origin=Origin.CORNER)


DSO: Final = {"pinhole": (4, 5, 8), "fov": (5,), "radtan": (8,), "equidistant": (8,), "kannalabrandt": (8,)}
"""How many numbers a model has; 4Seasons writes Equidistant, and eight numbers after Pinhole."""


DSO_MODES = ("crop", "full", "none")


DROID_LENGTHS = tuple(4 + count for count in COUNTS)


SMALLEST_PX = 32.0
"""A shorter focal length, or a principal point nearer the corner, is of no photograph."""


def _is_droid(content: Content) -> Sniff | None:
    """Nothing but one line of numbers, the first four of which could be a K in pixels."""
    numbers = numbers_of(content.lines) if len(content.lines) == 1 else None
    if numbers is None or len(numbers[0]) not in DROID_LENGTHS:
        return None
    fx, fy = numbers[0][:2]
    if min(numbers[0][:4]) < SMALLEST_PX or abs(fx - fy) > fx / 3:
        return None
    return Sniff(Sure.WEAK, f"one line of {len(numbers[0])} numbers, as fx fy cx cy and coefficients")


def _droid(data: bytes, context: ReadContext) -> Node:
    rows = [row for row in rows_of(data, most=MOST_BYTES) if row.strip()]
    if len(rows) != 1:
        raise ParseError(f"{len(rows)} lines of numbers, expected one")
    fx, fy, cx, cy, *k = strict.numbers(rows[0], count=DROID_LENGTHS)
    return document_of(context, K=[fx, fy, cx, cy], k=[*k])


def _is_dso(content: Content) -> Sniff | None:
    """Four lines: a camera, two numbers, the kind of rectification, two numbers."""
    if len(content.lines) != 4:
        return None
    first, size, rectified, made = content.lines
    name = first.split()[0].lower()
    counts = [len((numbers_of([row]) or [()])[0]) for row in (first, size, rectified, made)]
    is_camera = name in DSO or counts[0] in (5, 8)
    is_rectified = rectified.split()[0] in DSO_MODES or counts[2] in (4, 5)
    if not (is_camera and is_rectified and counts[1] == counts[3] == 2):
        return None
    return Sniff(Sure.MAGIC, f"four lines as DSO reads them, the third is {strict.shown(rectified)}")


def _dso(data: bytes, context: ReadContext) -> Node:
    """The first two lines; the last two are of the camera that DSO is to make."""
    rows = [row for line in text_of(data, most=MOST_BYTES).splitlines() if (row := line.split())]
    if len(rows) < 3:
        raise ParseError(f"{len(rows)} lines, expected the camera, its image size and what to make")
    row = rows[0]
    named = row[0].lower() if row[0][:1].isalpha() else "radtan" if len(row) == 8 else "fov"
    if named not in DSO:
        refuse_model(row[0], tuple(DSO), place="line 1")
    row = row[1:] if row[0][:1].isalpha() else row
    fx, fy, cx, cy, *k = strict.numbers(" ".join(row), count=DSO[named], place="line 1")
    size = strict.numbers(" ".join(rows[1]), count=2, place="line 2")
    if named == "pinhole" and any(k):
        raise ParseError("a Pinhole has no distortion, but there are numbers after K", place="line 1")
    model = f"{named} in fractions" if max(cx, cy) < 1 else named
    return document_of(context, model=model, K=[fx, fy, cx, cy], k=[*k], size=[*size])


_ORB_TIGHT = re.compile(r"^([ \t]*+[A-Za-z_][\w.]*+):(?=[^\s:])", re.MULTILINE)
_ORB_SETTING = re.compile(r"^([A-Za-z_][\w.]*+):[ \t]++([^\s#][^#\n]*+).*$", re.MULTILINE)
ORB_RESIZED = "ORB-SLAM resizes the images before it uses them; K is of the size before"
ORB_RECTIFIED = (
    "Camera is the rectified camera of the stereo pair; LEFT and RIGHT are the images as they were taken"
)


def _is_orb(content: Content) -> Sniff | None:
    """OpenVSLAM, which has Camera.model as well, is another format."""
    found = None if "Camera.model" in content.names else content.names & {"Camera.fx", "Camera1.fx"}
    return Sniff(Sure.MAGIC, f"the key {min(found)}") if found else None


def _orb_settings(data: bytes, context: ReadContext) -> Node:
    """Without keys that occur again with the same value, as settings put together by hand have them."""
    said: set[tuple[str, str]] = set()

    def kept(line: re.Match[str]) -> str:
        pair = line[1], line[2].strip()
        if pair in said:
            return ""
        said.add(pair)
        return line[0]

    # OpenCV needs no space after the colon; the directive's own colon stays.
    text = _ORB_TIGHT.sub(r"\1: ", text_of(data))
    return storage.load(_ORB_SETTING.sub(kept, text).encode(), source=context.name)


def _orb_cameras(tree: Node, _context: ReadContext) -> Named:
    """In the order of generations: Camera, Camera1, Camera2, LEFT, RIGHT."""
    named = [name for name in ("Camera", "Camera1", "Camera2") if f"{name}.fx" in tree]
    if not named:
        tree.fail("there is neither a Camera.fx nor a Camera1.fx")
    kind = tree["Camera.type"].text() if "Camera.type" in tree else "PinHole"
    size = {side: tree[f"Camera.{side}"].value for side in ("width", "height") if f"Camera.{side}" in tree}
    for name in (*named, *(side for side in ("LEFT", "RIGHT") if f"{side}.K" in tree)):
        own = {
            key.removeprefix(f"{name}."): node.value
            for key, node in tree.entries()
            if key.startswith(f"{name}.")
        }
        own = {**(size if own.keys().isdisjoint(size) else {}), **own, "none": 0.0}
        if "K" not in own:
            own["kind"] = "Rectified" if kind == "PinHole" and own.keys().isdisjoint(BROWN5[:4]) else kind
        yield name, Node(own, source=tree.source, place=name)


def _orb(tree: Node, node: Node, item: Calibration) -> Calibration:
    resized = (ORB_RESIZED,) if {"Camera.newWidth", "Camera.newHeight"} & {*tree.keys()} else ()
    rectified = (ORB_RECTIFIED,) if node.place == "Camera" and "LEFT.K" in tree else ()
    return item if "K" in node else noted(item, *resized, *rectified)


KALIBR = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=BROWN5[:4],
    remarks=(
        "equidistant's four are k1, k2, k3, k4",
        "xi, alpha and beta come before the focal lengths",
        "with omni and ds, K has the file's focal lengths, (1 + xi) times those of the pinhole near the axis",
    ),
)
KALIBR_SHAPES = {"pinhole": (), "omni": ("xi",), "eucm": ("alpha", "beta"), "ds": ("xi", "alpha")}
"""The camera models, each with what comes before fu, fv, pu, pv."""
KALIBR_REST = "kalibr/"
KALIBR_KEYS = frozenset({"camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "resolution"})


def _omni(values: Sequence[float]) -> Distortion:
    if values[0] < 0:
        raise ParseError(f"xi is {values[0]:g}, expected one from 0")
    return unified(values)


KALIBR_MODELS = {
    **{
        f"pinhole {kind}": Model(made, ("distortion_coeffs",), (count,))
        for kind, made, count in (
            ("radtan", lens, 4),
            ("equidistant", fisheye, 4),
            ("fov", field_of_view, 1),
            ("none", lens, 0),
        )
    },
    **{
        f"{camera} {kind}": Model(
            made,
            (f"intrinsics[0:{before}]", "distortion_coeffs"),
            (before + count,),
            K=(f"intrinsics[{before}:]",),
        )
        for camera, kind, made, before, count in (
            ("omni", "radtan", _omni, 1, 4),
            ("omni", "none", _omni, 1, 0),
            ("eucm", "none", extended_unified, 2, 0),
            ("ds", "none", double_sphere, 2, 0),
        )
    },
}
_CHAINED = re.compile(r"cam\d+")
_UNDER = re.compile(r"^[ \t]+(camera_model|distortion_coeffs|intrinsics)[ \t]*:", re.MULTILINE)


def _is_kalibr(content: Content) -> Sniff | None:
    """The key camera_model with coefficients under Kalibr's own name for them, in a cam0 or alone."""
    wanted = {"camera_model", "distortion_coeffs", "intrinsics"}
    if wanted <= content.names:
        return Sniff(Sure.MAGIC, "the keys camera_model, intrinsics and distortion_coeffs")
    under = set(_UNDER.findall(content.text or ""))
    camera = next((key for key in content.yaml_keys if _CHAINED.fullmatch(key)), None)
    if camera and "camera_model" in under:
        return Sniff(Sure.MAGIC, f"the key {camera} and camera_model under it")
    if wanted <= under:
        return Sniff(Sure.MAGIC, "a key with camera_model, intrinsics and distortion_coeffs under it")
    return None


def _kalibr_cameras(tree: Node, _context: ReadContext) -> Named:
    is_alone = "camera_model" in tree
    named = [(key, node) for key, node in tree.entries() if _CHAINED.fullmatch(key) or "camera_model" in node]
    if not is_alone and not named:
        tree.fail("there is neither a cam0 nor a camera_model")
    for name, node in [(None, tree)] if is_alone else named:
        # The last key first: a file cut short before it has no camera model that could be unknown.
        node["resolution"].numbers(2)
        yield name, node


def _kalibr(_tree: Node, node: Node, item: Calibration) -> Calibration:
    return _near_axis(with_rest(item, node, KALIBR_REST, KALIBR_KEYS), "fu")


def _kalibr_written(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """Kalibr's keys, cam0 first; the transforms between cameras go back where the chain's order is kept."""
    names = [item.camera.sub_camera for item in calibrations]
    in_order = names == [f"cam{index}" for index in range(len(calibrations))] or len(names) == 1
    lines: list[str] = []
    for index, item in enumerate(calibrations):
        lines.append(f"cam{index}:")
        lines += [f"  {row}" for row in _kalibr_rows(item, index, in_order=in_order)]
    return "".join(f"{line}\n" for line in lines).encode()


def _kalibr_rows(item: Calibration, index: int, *, in_order: bool) -> Iterator[str]:
    """One camera's lines; what makes it complete comes last."""
    K, (model, special, kind, values) = item.intrinsics, _kalibr_names(item.distortion or NoDistortion())
    native = KALIBR.native(K)
    extras = rest_of(item, KALIBR_REST)
    if not in_order:
        extras.pop("T_cn_cnm1", None)
        extras.pop("cam_overlaps", None)
    # Kalibr's own programs refuse a camera without one.
    extras.setdefault("rostopic", json.dumps(f"/cam{index}/image_raw"))
    for key, text in extras.items():
        yield f"{key if key.isidentifier() else scalar(key)}: {scalar(restored(text))}"
    yield f"camera_model: {model}"
    yield f"distortion_model: {kind}"
    yield f"distortion_coeffs: {flow(values)}"
    yield f"intrinsics: {flow([*special, native.fx, native.fy, native.cx, native.cy])}"
    yield f"resolution: [{K.image_size[0]}, {K.image_size[1]}]"


def _kalibr_names(lens: Distortion) -> tuple[str, list[float], str, list[float]]:
    """Camera model, its special numbers, distortion model, its coefficients."""
    values = list(lens.coefficients.values())
    if isinstance(lens, Unified):
        if lens.xi < 0:
            raise UnsupportedModelError(f"xi is {lens.xi:g}, and Kalibr's omni camera has one from 0 on")
        is_bent = any(values[1:])
        return "omni", values[:1], "radtan" if is_bent else "none", values[1:] if is_bent else []
    if isinstance(lens, ExtendedUnified | DoubleSphere):
        return "eucm" if isinstance(lens, ExtendedUnified) else "ds", values, "none", []
    kind = {KannalaBrandt: "equidistant", FieldOfView: "fov"}.get(type(lens), "radtan")
    # Not every program that reads chains knows a pinhole without distortion.
    return "pinhole", [], kind, values or [0.0] * 4


KALIBR_CLASSES = {
    "PinholeCameraGeometry": ("pinhole", "none"),
    "DistortedPinholeCameraGeometry": ("pinhole", "radtan"),
    "EquidistantPinholeCameraGeometry": ("pinhole", "equidistant"),
    "EquidistantDistortedPinholeCameraGeometry": ("pinhole", "equidistant"),
    "FovPinholeCameraGeometry": ("pinhole", "fov"),
    "FovDistortedPinholeCameraGeometry": ("pinhole", "fov"),
    "OmniCameraGeometry": ("omni", "none"),
    "DistortedOmniCameraGeometry": ("omni", "radtan"),
    "ExtendedUnifiedCameraGeometry": ("eucm", "none"),
    "DoubleSphereCameraGeometry": ("ds", "none"),
}
"""Kalibr's classes, each with the models of its camera chain."""
_GEOMETRY = re.compile(r"^\s*(cam\d+) \(.{0,200}\):\s*$", re.MULTILINE)
_CLASS = re.compile(r"type: <class '[\w.]{0,100}?\.?(\w{1,100})'>")
_WITH_SIGMA = re.compile(r"(distortion|projection): \[([^\[\]]{0,2000})\] \+- \[([^\[\]]{0,2000})\]")
DETAILS = ("Camera model", "Focal length", "Principal point", "Distortion model", "Distortion coefficients")
_BY_NAME = re.compile(r"^(cam\d+)[ \t]*\r?\n-+[ \t]*\r?\n((?:[ \t]+\S.*\n?)+)", re.MULTILINE)
_DETAIL = re.compile(r"^[ \t]+([A-Za-z][A-Za-z ]{0,40}): ?(.{0,2000}?)[ \t\r]*$", re.MULTILINE)


def _is_results(content: Content) -> Sniff | None:
    """The line of a camera, and what is under it."""
    text = content.text or ""
    if "CameraGeometry'>" in text and "projection: [" in text and _GEOMETRY.search(text):
        return Sniff(Sure.MAGIC, "a line 'cam0 (…):' with a type and a projection under it")
    if "Camera model: " in text and "Distortion coefficients: " in text and _BY_NAME.search(text):
        return Sniff(Sure.MAGIC, "a line 'cam0' with a camera model and distortion coefficients under it")
    return None


def _results(data: bytes, context: ReadContext) -> Node:
    """The cameras as the chain has them, in a list, for a name may come twice."""
    text = text_of(data)
    blocks = _GEOMETRY.split(text)[1:]
    cameras = [
        {"name": name, **_with_sigmas(name, block)}
        for name, block in zip(blocks[::2], blocks[1::2], strict=True)
    ]
    by_name = (
        [] if cameras else [{"name": name, **_by_name(name, block)} for name, block in _BY_NAME.findall(text)]
    )
    if not cameras and not by_name:
        raise ParseError("there is no camera, expected a line 'cam0 (…):' and its numbers")
    return document_of(context, cameras=[*cameras, *by_name])


def _by_name(name: str, block: str) -> dict[str, Json]:
    """The numbers that are printed by name."""
    said = dict(_DETAIL.findall(block))
    model = said.get("Camera model", "")
    special = {key.rpartition(" ")[2].lower(): text for key, text in said.items()}
    missing = [key for key in DETAILS if key not in said]
    missing += [key for key in KALIBR_SHAPES.get(model, ()) if key not in special]
    if missing:
        raise ParseError(f"there is no {', '.join(missing)}", place=name)
    own = [strict.number(special[key], place=f"{name}, {key}") for key in KALIBR_SHAPES.get(model, ())]
    focal, centre, coefficients = (
        strict.numbers(said[key].strip("[]").replace(",", " "), place=f"{name}, {key}")
        for key in ("Focal length", "Principal point", "Distortion coefficients")
    )
    return {
        "camera_model": model,
        "intrinsics": [*own, *focal, *centre],
        "distortion_model": said["Distortion model"],
        "distortion_coeffs": [*coefficients],
    }


def _with_sigmas(name: str, block: str) -> dict[str, Json]:
    """The numbers under a class, with their deviations in order: projection, distortion."""
    kind = _CLASS.search(block)
    if kind is None:
        raise ParseError("there is no type", place=name)
    if kind[1] not in KALIBR_CLASSES:
        raise UnsupportedModelError(
            f"the class is {strict.shown(kind[1])}, which is not known here; read the camera chain (camchain.yaml)",
            place=name,
        )
    values = {key: texts for key, *texts in _WITH_SIGMA.findall(block)}
    if values.keys() != {"distortion", "projection"}:
        raise ParseError("there is no distortion and projection, each with its deviations", place=name)
    numbers = {
        key: [strict.numbers(text, place=f"{name}, {key}") for text in texts] for key, texts in values.items()
    }
    for key, (own, sigmas) in numbers.items():
        strict.check_count(len(sigmas), len(own), place=f"{name}, {key}")
    model, distortion = KALIBR_CLASSES[kind[1]]
    return {
        "camera_model": model,
        "intrinsics": [*numbers["projection"][0]],
        "distortion_model": distortion,
        "distortion_coeffs": [*numbers["distortion"][0]],
        "sigmas": [*numbers["projection"][1], *numbers["distortion"][1]],
    }


def _results_quality(_tree: Node, node: Node, item: Calibration) -> Calibration:
    own, lens = KALIBR_SHAPES[node["camera_model"].text()], item.distortion
    bent = [name for name, value in (lens.coefficients if lens else {}).items() if name not in own and value]
    sigmas = node["sigmas"].numbers() if "sigmas" in node else ()
    std = {name: value for name, value in zip((*own, *K4, *bent), sigmas, strict=False) if value > 0}
    return _near_axis(replace(item, quality=Quality(std=std) if sigmas else None), "fu")


ROWS: Final = (
    Program(
        name="basalt",
        title="Basalt calibration",
        words="""\
Basalt's ``calibration.json``: all cameras of a rig, with their places beside the inertial unit.

In the format's own words::

    {"value0": {
        "T_imu_cam": […],
        "intrinsics": [
            {"camera_type": "ds",
             "intrinsics": {"fx": 349.2, "fy": 348.9, "cx": 365.7, "cy": 249.3, "xi": -0.2, "alpha": 0.56}}],
        "resolution": [[752, 480]], …}}

Every number is named. The camera types are ``pinhole``, ``pinhole-radtan8`` (OpenCV's rational model, good up to the
radius rpmax), ``kb4``, ``ucm`` and ``eucm`` (ucm being eucm with beta = 1), ``ds`` and ``fov`` (its angle is w).

Source: V. Usenko et al., basalt-headers, ``serialization/headers_serialization.h`` and ``camera/*.hpp``.
""",
        suffixes=(".json",),
        reference="https://gitlab.com/VladyslavUsenko/basalt-headers",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            remarks=(
                "coefficients are named",
                "with ds, K has the file's focal lengths, (1 + xi) times those of the pinhole near the axis",
            ),
        ),
        marks=(Mark(("camera_type",), at="value0.intrinsics[0]"),),
        cameras=_basalt_cameras,
        K=under("intrinsics", "fx fy cx cy"),
        size=("resolution",),
        model=("camera_type",),
        models={
            "pinhole": Model(),
            "pinhole-radtan8": Model(lens, under("intrinsics", "k1 k2 p1 p2 k3 k4 k5 k6")),
            "kb4": Model(fisheye, under("intrinsics", "k1 k2 k3 k4")),
            "ucm": Model(extended_unified, under("intrinsics", "alpha")),
            "eucm": Model(extended_unified, under("intrinsics", "alpha beta")),
            "ds": Model(double_sphere, under("intrinsics", "xi alpha")),
            "fov": Model(field_of_view, under("intrinsics", "w")),
        },
        finish=_basalt,
    ),
    Program(
        name="camodocal",
        title="camodocal and VINS camera",
        words="""\
camodocal's camera files, which VINS-Mono, VINS-Fusion and their kin read.

In the format's own words::

    %YAML:1.0
    ---
    model_type: PINHOLE              # PINHOLE_FULL, MEI, KANNALA_BRANDT, SCARAMUZZA
    camera_name: front
    image_width: 752
    image_height: 480
    distortion_parameters: { k1: -0.29, k2: 0.08, p1: 0.0002, p2: 0.00003 }
    projection_parameters: { fx: 461.2, fy: 459.8, cx: 362.7, cy: 248.5 }

PINHOLE_FULL adds k3 to k6 and is OpenCV's rational model. MEI has ``mirror_parameters: { xi: … }`` and calls its
focal lengths gamma1, gamma2, its principal point u0, v0. KANNALA_BRANDT has them all under
projection_parameters, mu, mv, u0, v0 beside k2, k3, k4, k5, which OpenCV counts from k1. VINS's own configuration
either contains a camera among its settings or names the camera's file under ``cam0_calib``.

Source: camodocal (``camera_models``), ``PinholeCamera.cc``, ``CataCamera.cc``, ``EquidistantCamera.cc``.
""",
        suffixes=(".yaml", ".yml"),
        reference="https://github.com/hengli/camodocal",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            remarks=(
                "coefficients are named; KANNALA_BRANDT's k2 to k5 are OpenCV's k1 to k4",
                "with MEI, K has gamma1 and gamma2, (1 + xi) times the focal lengths of the pinhole near the axis",
            ),
        ),
        marks=(
            *(Mark(("model_type", f"{kind}_parameters")) for kind in ("mirror", "poly", "projection")),
            *(Mark((f"cam{number}_calib",), sure=Sure.SHAPE) for number in range(8)),
        ),
        cameras=_camodocal_cameras,
        K=VINS_K,
        size=("image_width", "image_height"),
        model=("model_type",),
        models={
            "PINHOLE": Model(lens, PLAIN),
            "PINHOLE_FULL": Model(lens, (*PLAIN, *under("distortion_parameters", "k3 k4 k5 k6"))),
            "MEI": Model(
                unified,
                ("mirror_parameters.xi", *PLAIN),
                K=under("projection_parameters", "gamma1 gamma2 u0 v0"),
            ),
            "KANNALA_BRANDT": Model(
                fisheye,
                under("projection_parameters", "k2 k3 k4 k5"),
                K=under("projection_parameters", "mu mv u0 v0"),
            ),
        },
        finish=lambda _tree, _node, item: _near_axis(item, "gamma1"),
    ),
    Program(
        name="droid_calib",
        title="DROID-SLAM calibration (fx fy cx cy …)",
        words="""\
DROID-SLAM's calibration, one line of numbers, which DPVO, MASt3R-SLAM's kin and many scripts read as well.

In the format's own words (``calib/tum3.txt``, ``calib/barn.txt``, ``calib/euroc.txt``)::

    535.4 539.2 320.1 247.6
    458.654 457.296 367.215 248.375 -0.28340811 0.07395907 0.00019359 1.76187114e-05

They are fx, fy, cx, cy, followed by any coefficients that ``cv2.undistort`` takes: k1 k2 p1 p2, k3, and k4 k5 k6. The
program scales K with the images, so the file does not state their size.

Source: DROID-SLAM, ``demo.py``, ``image_stream``.
""",
        suffixes=(".txt",),
        reference="https://github.com/princeton-vl/DROID-SLAM",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=OPENCV_ORDER[:8],
            remarks=("one line: fx, fy, cx, cy and the coefficients",),
        ),
        recognise=_is_droid,
        load=_droid,
        K=("K",),
        size=(),
        models={"": Model(lens, ("k",))},
    ),
    Program(
        name="dso_camera",
        title="DSO camera.txt (TUM monoVO, 4Seasons)",
        words="""\
DSO's ``camera.txt``, which LSD-SLAM and the TUM monoVO, 4Seasons and VI datasets' tools share.

In the format's own words::

    RadTan 458.654 457.296 367.215 248.375 -0.2834 0.0740 0.00019 0.00002
    752 480                 # the images
    crop                    # full, none, or "fx fy cx cy 0": the rectified camera that DSO is to make
    640 480                 # its images

The models are Pinhole, FOV (omega after K) and RadTan, EquiDistant, KannalaBrandt with four coefficients each; without
a name five numbers are FOV, or Pinhole where the last is 0, and eight are RadTan. RadTan is OpenCV's k1 k2 p1 p2,
EquiDistant and KannalaBrandt are cv2.fisheye's. Where cx and cy are below 1, all of K is in fractions of the sides,
and the principal point counts from the corner of the first pixel: DSO takes half a pixel off. Else the numbers are
K itself.

Source: DSO, README.md "Geometric Calibration File" and ``src/util/Undistort.cpp``.
""",
        suffixes=(".txt",),
        reference="https://github.com/JakobEngel/dso",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=OPENCV_ORDER[:4],
            remarks=(
                "EquiDistant's and KannalaBrandt's four are cv2.fisheye's k1, k2, k3, k4",
                "where cx and cy are below 1, K is in fractions of each side, from the outer corner of the top-left "
                "pixel",
            ),
        ),
        recognise=_is_dso,
        load=_dso,
        K=("K",),
        size=("size",),
        model=("model",),
        models={
            name + unit: Model(made, numbers, convention=convention)
            for unit, convention in (("", None), (" in fractions", IN_FRACTIONS))
            for name, made, numbers in (
                ("pinhole", lambda _: NoDistortion(), ()),
                ("fov", field_of_view, ("k",)),
                ("radtan", lens, ("k",)),
                ("equidistant", fisheye, ("k",)),
                ("kannalabrandt", fisheye, ("k",)),
            )
        },
    ),
    Program(
        name="euroc",
        title="EuRoC/ASL sensor.yaml and Kimera-VIO camera",
        words="""\
The ASL dataset format's ``sensor.yaml``, which came with the EuRoC recordings, and Kimera-VIO's camera files.

In the format's own words::

    sensor_type: camera
    comment: front, 5 mm
    T_BS: …                                                  # the sensor in the body's frame
    rate_hz: 20
    resolution: [752, 480]
    camera_model: pinhole
    intrinsics: [458.1, 457.9, 367.2, 248.4]                 # fu, fv, cu, cv
    distortion_model: radial-tangential                      # or equidistant
    distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]  # k1, k2, p1, p2

The numbers are Kalibr's, the names of the models are not. Kimera-VIO has ``camera_id`` in place of sensor_type, says
radtan as well, and hands both lenses to OpenCV. Its omni cameras are OCamCalib's::

    camera_model: omni
    intrinsics: []                                           # or those of a pinhole to undistort to
    distortion_model: omni
    distortion_coefficients: [875.1, 0.0, -3.0e-4, -4.8e-8, 1.7e-11]
    omni_affine: [a, b, c]
    omni_distortion_center: [1005.8, 743.0]                  # u, v

A pixel is (u, v) = (1 a; b c)·(x, y) + centre, and its ray (x, y, d0 + d1·ρ + d2·ρ² + d3·ρ³ + d4·ρ⁴) with ρ² = x² + y².
K is d0·(1 a; b c) brought to its upper triangle, as for OCamCalib's own file; it is not what ``intrinsics`` states.

Sources: ETH Zürich ASL, "The EuRoC MAV datasets", ``dataset_tools``; Kimera-VIO, ``src/frontend/CameraParams.cpp`` and
``src/frontend/Camera.cpp`` (BackProjectOmni).
""",
        suffixes=(".yaml",),
        reference="https://projects.asl.ethz.ch/datasets/doku.php?id=kmavvisualinertialdatasets",
        convention=EUROC,
        marks=(
            Mark(("sensor_type", "camera_model")),
            Mark(("camera_model", "intrinsics", "distortion_model", "distortion_coefficients", "resolution")),
        ),
        cameras=_euroc_cameras,
        K=("intrinsics",),
        size=("resolution",),
        model=("camera_model", "distortion_model"),
        models={
            **{
                f"pinhole {kind}": Model(lens, ("distortion_coefficients",), (4,))
                for kind in ("radial-tangential", "radtan")
            },
            "pinhole equidistant": Model(fisheye, ("distortion_coefficients",), (4,)),
            "pinhole none": Model(),
            **{
                f"omni{kind}": Model(taylor, ("distortion_coefficients",), (5,), K=OF_RAY)
                for kind in (" omni", " none", "")
            },
        },
        finish=_euroc,
        write=_euroc_written,
        capacity=Capacity(models=(NoDistortion, BrownWithoutK3, KannalaBrandt)),
    ),
    Program(
        name="kalibr",
        title="Kalibr camera chain",
        words="""\
Kalibr's camera chain, ``camchain*.yaml``: the output of ``kalibr_calibrate_cameras``.

In the format's own words::

    cam0:
      camera_model: pinhole                                  # omni, eucm, ds
      intrinsics: [3650.1, 3649.8, 2736.2, 1824.7]           # fu, fv, pu, pv
      distortion_model: radtan                               # equidistant, fov, none
      distortion_coeffs: [-0.0125, 0.0231, -0.0004, 0.0008]  # k1, k2, p1, p2
      resolution: [5472, 3648]
      rostopic: /cam0/image_raw
      T_cn_cnm1: …                                           # from the camera before to this one
    cam1: …

The parameters of a camera model come *before* the focal lengths: omni has xi, eucm alpha, beta and ds xi, alpha first.
omni multiplies by the generalised focal length of Mei's model, so near its axis the camera is a pinhole of fu/(1 + xi);
the same holds for ds. A single camera may be without the ``cam0`` around it, and people call cameras otherwise.
OpenVINS keeps the format under OpenCV's directive ``%YAML:1.0``.

Source: Kalibr, "Supported models" and "YAML formats" of its wiki; ``kalibr_common/ConfigReader.py``.
""",
        suffixes=(".yaml", ".yml"),
        reference="https://github.com/ethz-asl/kalibr/wiki/yaml-formats",
        convention=KALIBR,
        recognise=_is_kalibr,
        cameras=_kalibr_cameras,
        K=("intrinsics",),
        size=("resolution",),
        model=("camera_model", "distortion_model"),
        models=KALIBR_MODELS,
        finish=_kalibr,
        write=_kalibr_written,
        capacity=Capacity(
            models=(
                NoDistortion,
                BrownWithoutK3,
                KannalaBrandt,
                Unified,
                ExtendedUnified,
                DoubleSphere,
                FieldOfView,
            ),
            several_cameras=True,
        ),
    ),
    Program(
        name="kalibr_results",
        title="Kalibr results (results-cam.txt)",
        words="""\
Kalibr's ``results-cam-*.txt``, what its calibrators print, with the standard deviations.

In the format's own words::

    Calibration results
    ====================
    Camera-system parameters:
    cam0 (/cam0/image_raw):
        type: <class 'aslam_cv.libaslam_cv_python.DistortedPinholeCameraGeometry'>
        distortion: [-0.2134  0.0447 -0.0004  0.0008] +- [0.0012 0.0011 0.0001 0.0001]
        projection: [433.21 432.93 371.58 238.34] +- [0.13 0.12 0.22 0.24]
        reprojection error: [0.000012, -0.000003] +- [0.120000, 0.090000]

    baseline T_1_0: …

Of a camera with an IMU (``results-imucam-*.txt``) it prints each number by name, without deviations::

    cam0
    -----
      Camera model: pinhole
      Focal length: [433.21, 432.93]
      Principal point: [371.58, 238.34]
      Distortion model: radtan
      Distortion coefficients: [-0.2134, 0.0447, -0.0004, 0.0008]

The numbers and their order are those of the camera chain (``kalibr``); the class names the models. The deviations are
one sigma. The file does not state the image size, but the chain beside it does.

Sources: Kalibr, ``kalibr_camera_calibration/CameraUtils.py``, ``printParameters`` and ``saveResultTxt``;
``kalibr_common/ConfigReader.py``, ``CameraParameters.printDetails``.
""",
        suffixes=(".txt",),
        reference="https://github.com/ethz-asl/kalibr/wiki/multiple-camera-calibration",
        convention=KALIBR,
        recognise=_is_results,
        load=_results,
        cameras=lambda tree, _: (
            (node["name"].text(), replace(node, place=node["name"].text()))
            for node in tree["cameras"].items()
        ),
        K=("intrinsics",),
        size=(),
        model=("camera_model", "distortion_model"),
        models=KALIBR_MODELS,
        finish=_results_quality,
    ),
    Program(
        name="maplab",
        title="maplab and SVO camera rig (ncamera.yaml)",
        words="""\
maplab's and SVO's camera rigs (``ncamera.yaml``, ``sensors.yaml``), as aslam_cv2 writes them.

In the format's own words::

    label: "VISensor"
    cameras:
    - camera:
        label: cam0
        image_height: 480
        image_width: 752
        type: pinhole                                   # unified-projection
        intrinsics: {cols: 1, rows: 4, data: [458.655, 457.297, 367.216, 248.375]}
        distortion:
          type: radial-tangential                       # equidistant, fisheye, none
          parameters: {cols: 1, rows: 4, data: [-0.2834, 0.0740, 0.00019, 0.00002]}
      T_B_C: …

``sensors.yaml`` has the same under ``sensors``, beside the rig's other sensors. A unified projection has xi before
its focal lengths, (1 + xi) times those of the pinhole near the axis; ``fisheye`` is the FOV model of Devernay and
Faugeras, and equidistant cv2.fisheye's.

Source: aslam_cv2, ``aslam_cv_cameras/src/{camera-yaml-serialization,distortion-radtan,distortion-fisheye}.cc``.
""",
        suffixes=(".yaml", ".yml"),
        reference="https://github.com/ethz-asl/maplab",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=BROWN5[:4],
            remarks=(
                "equidistant's four are k1, k2, k3, k4",
                "with unified-projection, xi comes before the focal lengths, which are (1 + xi) times those of the "
                "pinhole",
            ),
        ),
        marks=tuple(
            Mark((rig,), inner=("camera", "image_height", "type", "intrinsics", "distortion"))
            for rig in ("cameras", "sensors", "ncameras")
        ),
        cameras=_maplab_cameras,
        K=("intrinsics",),
        size=("image_width", "image_height"),
        model=("type", "distortion.type"),
        models={
            "pinhole none": Model(),
            "pinhole radial-tangential": Model(lens, MAPLAB_LENS, (4,)),
            "pinhole equidistant": Model(fisheye, MAPLAB_LENS, (4,)),
            "pinhole fisheye": Model(field_of_view, MAPLAB_LENS, (1,)),
            "unified-projection none": Model(unified, ("intrinsics[0:1]",), K=("intrinsics[1:]",)),
            "unified-projection radial-tangential": Model(
                unified, ("intrinsics[0:1]", *MAPLAB_LENS), (5,), K=("intrinsics[1:]",)
            ),
        },
        idle=MAPLAB_LENS,
    ),
    Program(
        name="okvis",
        title="OKVIS configuration",
        words="""\
OKVIS's configuration: the cameras of a visual-inertial rig.

In the format's own words::

    %YAML:1.0
    cameras:
         - {T_SC: [ … ],                                                    # from the camera to the rig
            image_dimension: [752, 480],
            distortion_coefficients: [-0.2834, 0.0740, 0.00019, 0.00002],   # k1, k2, p1, p2
            distortion_type: radialtangential,                              # radialtangential8, equidistant
            focal_length: [458.655, 457.296],
            principal_point: [367.216, 248.375]}

radialtangential8, or plumb_bob8, is OpenCV's rational model, and equidistant cv2.fisheye's. A configuration without
``cameras`` leaves them to the sensor, and there is nothing to read.

Source: OKVIS, ``okvis_common/src/VioParametersReader.cpp`` and ``okvis_cv/include/okvis/cameras``.
""",
        suffixes=(".yaml", ".yml"),
        reference="https://github.com/ethz-asl/okvis",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=OPENCV_ORDER[:8],
            remarks=("equidistant's four are k1, k2, k3, k4",),
        ),
        marks=(Mark(("cameras",), words=("image_dimension:", "distortion_type:")),),
        cameras=listed("cameras"),
        K=("focal_length", "principal_point"),
        size=("image_dimension",),
        model=("distortion_type",),
        models={
            name: Model(made, ("distortion_coefficients",), (count,))
            for name, made, count in (
                ("radialtangential", lens, 4),
                ("plumb_bob", lens, 4),
                ("radialtangential8", lens, 8),
                ("plumb_bob8", lens, 8),
                ("equidistant", fisheye, 4),
            )
        },
    ),
    Program(
        name="orb_slam",
        title="ORB-SLAM2/3 settings",
        words="""\
ORB-SLAM's settings, versions 2 and 3: a camera among the program's own numbers.

In the format's own words::

    %YAML:1.0
    File.version: "1.0"
    Camera.type: "PinHole"           # KannalaBrandt8, Rectified
    Camera1.fx: 458.6                # version 2 and older files of 3: Camera.fx, …
    Camera1.fy: 457.3
    Camera1.cx: 367.2
    Camera1.cy: 248.4
    Camera1.k1: -0.28                # k1, k2, p1, p2 and perhaps k3; KannalaBrandt8: k1, k2, k3, k4
    …
    Camera.width: 752
    Camera.height: 480
    Camera.newWidth: 600             # the program resizes; the numbers above are of the size before

A second fisheye is ``Camera2.``. In older stereo settings ``Camera.`` is the rectified camera, and the two as they
were taken follow as matrices, ``LEFT.K``, ``LEFT.D``, ``RIGHT.K``, ``RIGHT.D``. Older files lack the image size.
The text is OpenCV's YAML, which takes ``Viewer.PointSize:2`` without a space for a key and its value.

Source: ORB_SLAM3, ``Examples/*/*.yaml``, ``src/Settings.cc`` and "Calibration_Tutorial.pdf".
""",
        suffixes=(".yaml",),
        reference="https://github.com/UZ-SLAMLab/ORB_SLAM3",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            remarks=("coefficients are named; KannalaBrandt8's four are k1, k2, k3, k4",),
        ),
        recognise=_is_orb,
        load=_orb_settings,
        cameras=_orb_cameras,
        K=K4,
        model=("kind",),
        models={
            "PinHole": Model(lens, (*BROWN5[:4], "k3|none")),
            "KannalaBrandt8": Model(fisheye, FISHEYE4),
            "Rectified": Model(),
            "": Model(lens, ("D",), COUNTS, K="K"),
        },
        finish=_orb,
        idle=("Camera.k1", "Camera.k2", "Camera.k3", "Camera.k4", "Camera.p1", "Camera.p2"),
    ),
    Program(
        name="stella_vslam",
        title="stella_vslam and OpenVSLAM settings",
        words="""\
stella_vslam's settings, OpenVSLAM's before it: a camera among the program's own numbers.

In the format's own words::

    Camera:
      name: "EuRoC monocular"
      setup: "monocular"            # stereo, RGBD
      model: "perspective"          # fisheye, radial_division, equirectangular
      fx: 458.654
      fy: 457.296
      cx: 367.215
      cy: 248.375
      k1: -0.2834                   # perspective: k1, k2, p1, p2, k3; fisheye: k1, k2, k3, k4
      …                             # radial_division: distortion
      fps: 20.0
      cols: 752
      rows: 480

OpenVSLAM's older files have the same names flat, ``Camera.model`` and so on. The program hands perspective and
fisheye to OpenCV; radial_division sees (x', y', 1 + distortion·r'²), Fitzgibbon's division model. An equirectangular
panorama has no K.

Source: stella_vslam, ``src/stella_vslam/camera/{base,perspective,fisheye,radial_division}.cc``.
""",
        suffixes=(".yaml", ".yml"),
        reference="https://stella-cv.readthedocs.io/en/latest/parameters.html",
        convention=STELLA,
        marks=(Mark(("Camera.model",)), Mark(("Camera",), inner=("model", "setup", "cols", "rows"))),
        cameras=_stella_camera,
        K=K4,
        size=("cols", "rows"),
        model=("model",),
        models=STELLA_LENSES,
        finish=lambda _tree, node, item: with_rest(item, node, STELLA_REST, STELLA_KEYS),
        write=_stella_written,
        capacity=Capacity(models=(NoDistortion, BrownConrady, KannalaBrandt, Division)),
        idle=(
            "Camera.k1",
            "Camera.k2",
            "Camera.k3",
            "Camera.k4",
            "Camera.p1",
            "Camera.p2",
            "Camera.distortion",
        ),
    ),
    Program(
        name="vikit",
        title="vikit camera (SVO, FAST-LIVO2)",
        words="""\
vikit's camera parameters, which SVO, FAST-LIVO and FAST-LIVO2 read.

In the format's own words::

    cam_model: Pinhole             # EquidistantCamera, ATAN, PolynomialCamera, Ocam
    cam_width: 640
    cam_height: 512
    scale: 0.5                     # the program shrinks its images by it before use
    cam_fx: 431.795
    cam_fy: 431.550
    cam_cx: 310.833
    cam_cy: 266.986
    cam_d0: -0.0944                # k1
    cam_d1: 0.0947                 # k2
    cam_d2: -0.0081                # p1
    cam_d3: 0.0001                 # p2

EquidistantCamera has k1 to k4 of cv2.fisheye. ATAN is the FOV model with cam_d0 its angle, and there cam_fx … cam_cy
are fractions of the image's sides, counted from the corner of the first pixel. A coefficient that is left out is
zero. PolynomialCamera, which FAST-LIVO2's FishPoly is as well, takes θ to θ(1 + k2·θ + k3·θ² + … + k7·θ⁶); it is read
where k5, k6 and k7 are zero. SVO Pro has ``cam0``, ``cam1`` … with these names in them, and calls the models
PinholeNoDistortion, PinholeRadialTangential and PinholeEquidistant, whose k1 to k4 are cam_d0 to cam_d3.

Sources: rpg_vikit as FAST-LIVO2 has it, ``vikit_ros/include/vikit/camera_loader.h`` and
``vikit_common/src/{polynomial,atan}_camera.cpp``; rpg_svo_pro_open, ``vikit_cameras/src/camera_factory.cpp``.
""",
        suffixes=(".yaml", ".yml"),
        reference="https://github.com/xuankuzcr/rpg_vikit",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=VIKIT_FOUR,
            remarks=(
                "they are OpenCV's k1, k2, p1, p2; EquidistantCamera has k1 to k4 of cv2.fisheye",
                "ATAN's K is in fractions of each side, from the outer corner of the top-left pixel",
            ),
        ),
        marks=(
            Mark(("cam_model", "cam_width", "cam_fx")),
            Mark(("cam_num", "cam_0"), words=("cam_model:",)),
            Mark(("cam0",), inner=("cam_model", "cam_width", "cam_fx")),
        ),
        cameras=_vikit_cameras,
        K=VIKIT_K,
        size=("cam_width|image_width", "cam_height|image_height"),
        model=("cam_model",),
        models={
            "Pinhole": Model(lens, VIKIT_FOUR, missing=0.0),
            "EquidistantCamera": Model(fisheye, FISHEYE4, missing=0.0),
            "PinholeNoDistortion": Model(),
            "PinholeRadialTangential": Model(lens, VIKIT_FOUR, missing=0.0),
            "PinholeEquidistant": Model(fisheye, VIKIT_FOUR),
            "ATAN": Model(
                field_of_view, ("cam_d0",), convention=Convention(unit=Unit.EACH_SIDE, origin=Origin.CORNER)
            ),
            "PolynomialCamera": VIKIT_POLYNOMIAL,
            "FishPoly": VIKIT_POLYNOMIAL,
        },
        finish=_vikit,
    ),
)
"""In alphabetical order."""
