"""Rows of the table of programs' formats: the cameras of scenes, of data sets and of their readers.

To add one, add its row, and its sample with the formula computed independently to the tests of the formats.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from typing import Final

from calibrary.arrays import np
from calibrary.calibration import Calibration, Grade, ImageSize, Quality
from calibrary.distortion import (
    Distortion,
)
from calibrary.errors import InputError, ParseError
from calibrary.parsers import names
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._lenses import (
    COUNTS,
    OPENCV_ORDER,
    field_of_view,
    fisheye,
    lens,
    radial,
)
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN
from calibrary.parsers.formats._table import (
    MOST_BYTES,
    UNKNOWN_LENS,
    Mark,
    Model,
    Named,
    Program,
    document_of,
    find,
    noted,
    numbers_of,
    one_each,
    under,
    with_more,
)
from calibrary.parsers.formats._text_rows import keyed, rows_of, text_of
from calibrary.parsers.formats._tree import NPY, arrays, names_of_arrays
from calibrary.parsers.names import simplified
from calibrary.records import Json, replace


def _open3d_cameras(tree: Node, _context: ReadContext) -> Named:
    if "intrinsic_matrix" in tree or "intrinsic" in tree:
        yield None, find(tree, "intrinsic") or tree
        return
    for image in tree["parameters"].items():
        yield image["intrinsic"].place, image["intrinsic"]


def _runs_down_columns(node: Node) -> bool:
    numbers = node["intrinsic_matrix"].value
    return isinstance(numbers, list) and len(numbers) == 9 and numbers[2] == numbers[5] == 0


def _open3d(_tree: Node, node: Node, item: Calibration) -> Calibration:
    """With the coefficients that others add to Open3D's document, in OpenCV's order."""
    key = next((key for key, _ in node.entries() if simplified(key) in names.COEFFICIENTS), None)
    if key is None:
        return item
    values = storage.numbers(node[key])
    strict.check_count(len(values), COUNTS[2:], place=node[key].place)
    return noted(
        replace(item, distortion=lens(values)), f"Open3D has no distortion; {key} was read in OpenCV's order"
    )


FIRST_OF_ITS_KIND = 0x80000000
"""cereal's high bit: what follows is new, its name or its data comes with it."""


UNNAMED = 0x40000000
"""cereal's number for an object of the very class the pointer is declared for, which has no name."""


OPENMVG_ORIGIN = (
    "OpenMVG does not state if it counts from the centre of the first pixel or its corner; the centre was "
    "assumed"
)


OPENMVG = {
    "pinhole_radial_k1": Model(radial, ("disto_k1",), (1,)),
    "pinhole_radial_k3": Model(radial, ("disto_k3",), (3,)),
    "pinhole_brown_t2": Model(lambda k: lens((*k[:2], *k[3:], k[2])), ("disto_t2",), (5,)),
    "fisheye": Model(fisheye, ("fisheye",), (4,)),
    "pinhole": Model(),
}


def _openmvg_cameras(tree: Node, _context: ReadContext) -> Named:
    """Each by its key with its class, cereal's abbreviations written out."""
    names: dict[int, str] = {}
    objects: dict[int, Node] = {}
    for entry in tree["intrinsics"].items():
        value = entry["value"]
        number, wrapper = value["polymorphic_id"].whole(), value["ptr_wrapper"]
        if number >= FIRST_OF_ITS_KIND:
            names[number - FIRST_OF_ITS_KIND] = value["polymorphic_name"].text()
        pointer = wrapper["id"].whole()
        if pointer >= FIRST_OF_ITS_KIND:
            objects[pointer - FIRST_OF_ITS_KIND] = wrapper["data"]
        here = objects.get(pointer % FIRST_OF_ITS_KIND)
        if here is None:
            wrapper.fail(f"it points to object {pointer}, which does not come before it")
        name = names.get(number % FIRST_OF_ITS_KIND)
        if name is None and number != UNNAMED:
            value.fail(f"its class has number {number}, to which no name was given before")
        by_keys = next(kind for kind, model in OPENMVG.items() if set(model.numbers) <= set(here.keys()))
        yield str(entry["key"].whole()), with_more(here, {"kind": name or by_keys})


def _openmvg(tree: Node, node: Node, item: Calibration) -> Calibration:
    """A start where nothing is posed and the camera is as OpenMVG makes it of EXIF or a table of sensors."""
    (width, height), centre = item.intrinsics.image_size, node["principal_point"].numbers(2)
    is_touched = centre != (width / 2, height / 2) or (
        item.distortion is not None and any(item.distortion.coefficients.values())
    )
    posed = find(tree, "extrinsics")
    origin = replace(
        item.provenance,
        tool=f"OpenMVG, sfm_data version {tree['sfm_data_version'].text()}",
        tag=f"intrinsic {item.camera.sub_camera}",
    )
    item = noted(replace(item, provenance=origin), OPENMVG_ORIGIN)
    if is_touched or (posed is not None and posed.items()):
        return item
    start = "no image is posed, so this is what OpenMVG starts from, out of EXIF or a table of sensors"
    return noted(replace(item, grade=Grade.PRIOR), start)


THEIA_RADIAL = "radial_distortion_coeffs"


MOST_IMAGES = 100_000


ARGOVERSE: Final[dict[str, ImageSize]] = {"image_raw_ring_": (1920, 1200), "image_raw_stereo_": (2464, 2056)}
"""Image sizes by the beginning of a camera's name."""


ARGOVERSE_K = (
    "focal_length_x_px_",
    "focal_length_y_px_",
    "focal_center_x_px_",
    "focal_center_y_px_",
    "skew_",
)


NSVF_SHAPES = ((4, 3, 1, 1, 2), (4, 3, 1, 2), (4, 3, 1, 1, 2, 1), (4, 3, 1, 2, 1))
"""How many numbers each line has; the last may say which way the poses go."""


EQUAL_PX = 0.01
"""K of single-precision matrices differ by less from image to image."""


_WORLD = re.compile(r"world_mat_\d{1,7}")


_SHAPE_OF_17 = re.compile(rb"'shape':\s*\(\d{1,9},\s*17\)")


def _argoverse_cameras(tree: Node, _context: ReadContext) -> Named:
    for item in tree["camera_data_"].items():
        name = item["key"].text()
        size = next((size for start, size in ARGOVERSE.items() if name.startswith(start)), None)
        kind = "rectified" if name.endswith("_rect") else "raw"
        yield name, with_more(item["value"], {"size": list(size) if size else None, "kind": kind})


def _argoverse(_tree: Node, node: Node, item: Calibration) -> Calibration:
    if find(node, "size") is not None:
        taken = "the file does not state image sizes; those of Argoverse's cameras of this name were taken"
        provenance = replace(item.provenance, assumptions=(*item.provenance.assumptions, taken))
        item = noted(replace(item, provenance=provenance), taken)
    if node["kind"].text() == "raw":
        return item
    return noted(item, "distortion_coefficients_ is of the raw images; a rectified camera has no distortion")


def _is_llff(content: Content) -> Sniff | None:
    if not content.data.startswith(NPY) or not _SHAPE_OF_17.search(content.data[:4096]):
        return None
    return Sniff(Sure.SHAPE, "a numpy file with 17 columns, as LLFF's poses_bounds")


def _llff(data: bytes, context: ReadContext) -> Node:
    """Height, width and focal length of each image, and how many images have them."""
    from calibrary.parsers.formats import _npy  # noqa: PLC0415  loads numpy

    rows = _npy.array(data)
    if rows.ndim != 2 or rows.shape[1] != 17 or not 0 < len(rows) <= MOST_IMAGES:
        raise ParseError(f"an array of shape {rows.shape}, expected rows of 17 numbers")
    views = Counter(map(tuple, rows[:, (4, 9, 14)].tolist()))
    return document_of(
        context,
        cameras={
            f"camera {number}": {"size": [width, height], "K": [f, f, 0.0, 0.0], "views": count}
            for number, ((height, width, f), count) in enumerate(views.items(), start=1)
        },
    )


def _is_neus(content: Content) -> Sniff | None:
    names = names_of_arrays(content.data)
    if any(_WORLD.fullmatch(name) for name in names) and any(name.startswith("scale_mat_") for name in names):
        return Sniff(Sure.MAGIC, "a zip archive of numpy arrays with world_mat_0 and scale_mat_0")
    return None


def _neus(data: bytes, context: ReadContext) -> Node:
    """K of the images, by the name of the first that has it, and how many have it."""
    images: dict[str, tuple[tuple[float, ...], int]] = {}
    for name, node in Node(arrays(data), source=context.name).entries():
        if not _WORLD.fullmatch(name):
            continue
        K = of_projection(node.matrix(4, 4)[:3], place=name)
        alike = (one for one, (known, _) in images.items() if math.dist(known, K) < EQUAL_PX)
        same = next(alike, name)
        first, count = images.get(same, (K, 0))
        images[same] = first, count + 1
    if not images:
        raise ParseError("there is no world_mat_0")
    cameras: dict[str, Json] = {}
    for name, (K, count) in images.items():
        skew = K[4] if abs(K[4]) >= EQUAL_PX else 0.0
        cameras[name] = {"K": [*K[:4], skew], "views": count}
    return document_of(context, cameras=cameras)


def _counted(tree: Node, _context: ReadContext) -> Named:
    yield from ((name, replace(node, place=name)) for name, node in tree["cameras"].entries())


def _viewed(_tree: Node, node: Node, item: Calibration) -> Calibration:
    return replace(item, quality=Quality(views=node["views"].whole()))


def _mvsnet(data: bytes, context: ReadContext) -> Node:
    head, word, rest = text_of(data, most=MOST_BYTES).partition("\nintrinsic")
    if not head.lstrip().startswith("extrinsic") or not word:
        raise ParseError("there are no lines 'extrinsic' and 'intrinsic'")
    numbers = [strict.number(part, place="intrinsic") for part in rest.split()[:9]]
    return document_of(context, intrinsic=[*numbers])


def _is_mvsnet(content: Content) -> Sniff | None:
    """The two words, each on a line of its own."""
    if content.first_line == "extrinsic" and "intrinsic" in content.lines:
        return Sniff(Sure.MAGIC, "the lines 'extrinsic' and 'intrinsic'")
    return None


def _is_named(content: Content) -> Sniff | None:
    """The names of either."""
    if not any(name in (content.text or "") for name in ("fx_color", "doffs")):
        return None
    names = {line.partition("=")[0].strip() for line in content.lines}
    if {"fx_color", "mx_color", "colorWidth"} <= names:
        return Sniff(Sure.MAGIC, "the names fx_color, mx_color and colorWidth of ScanNet")
    if {"cam0", "width", "height", "doffs"} <= names:
        return Sniff(Sure.MAGIC, "the names cam0, doffs, width and height of Middlebury")
    return None


def _named(data: bytes, context: ReadContext) -> Node:
    values: dict[str, Json] = {}
    for row in rows_of(data, most=MOST_BYTES):
        name, mark, value = (part.strip() for part in row.partition("="))
        if mark and name in values:
            raise ParseError("it is a duplicate key", place=name)
        if mark:
            values[name] = value
    return Node(values, source=context.name)


def _named_cameras(tree: Node, _context: ReadContext) -> Named:
    """Middlebury's left and right one, or ScanNet's of colour and depth, each with the same names."""
    for name in ("cam0", "cam1"):
        if name in tree:
            size: Json = [tree["width"].value, tree["height"].value]
            K = strict.numbers(
                tree[name].text().strip("[]").replace(";", " "), count=9, source=tree.source, place=name
            )
            yield name, with_more(tree, {"kind": "rectified", "K": [*K], "size": size})
    for name in ("color", "depth") if "cam0" not in tree else ():
        if f"fx_{name}" in tree:
            numbers = [
                strict.number(tree[f"{key}_{name}"].text(), place=f"{key}_{name}")
                for key in ("fx", "fy", "mx", "my")
            ]
            sides = [tree[f"{name}{side}"].value for side in ("Width", "Height")]
            yield name, with_more(tree, {"kind": "", "K": [*numbers], "size": [*sides]})


def _is_nsvf(content: Content) -> Sniff | None:
    """Lines of four, three, one and two numbers."""
    rows = numbers_of(content.lines) if 4 <= len(content.lines) <= 6 else None
    if rows is None or (shape := tuple(map(len, rows))) not in NSVF_SHAPES:
        return None
    return Sniff(Sure.SHAPE, f"lines of {', '.join(map(str, shape))} numbers")


def _nsvf(data: bytes, context: ReadContext) -> Node:
    rows = [strict.numbers(row) for row in rows_of(data, most=MOST_BYTES) if row.strip()]
    shape = tuple(map(len, rows))
    if shape not in NSVF_SHAPES:
        listed = ", ".join(map(str, shape))
        raise ParseError(f"lines of {listed or 'no'} numbers, expected 4, 3, 1, (1,) 2")
    first, second, third, fourth = rows[0]
    K = [first, first, second, third] if fourth == 0 else [first, second, third, fourth]
    return document_of(context, K=[*K], size=[*rows[shape.index(2)][::-1]])


def _nuscenes_cameras(tree: Node, _context: ReadContext) -> Named:
    """Those of the sensors that have a matrix."""
    tokens = set[str]()
    for item in tree.items():
        if item["camera_intrinsic"].value == []:
            continue
        token = item["token"].text()
        if token in tokens:
            item["token"].fail("it is a duplicate token")
        tokens.add(token)
        yield token, replace(item, place=token)


def _theia_cameras(tree: Node, _context: ReadContext) -> Named:
    """The images that state a focal length, or all where none does, with all of K and of the lens."""
    every = [item["CameraIntrinsicsPrior"] for item in tree["priors"].items()]
    for node in [one for one in every if "focal_length" in one] or every:
        f, (cx, cy) = node["focal_length"].number(), node["principal_point"].numbers(2)
        aspect, skew = one_each(node, ("aspect_ratio",), 1.0) + one_each(node, ("skew",), 0.0)
        tangential = node.get("tangential_distortion_coeffs")
        p: Json = [] if tangential is None else [*tangential.numbers((0, 2))]
        name = node["image_name"].text()
        K: Json = {"fx": f, "fy": f * aspect, "cx": cx, "cy": cy, "skew": skew}
        yield name, replace(with_more(node, {"K": K, "tangential": p or [0.0, 0.0]}), place=name)


def _theia_lens(values: Sequence[float]) -> Distortion:
    p1, p2, *k = values
    k1, k2, k3 = (*k, 0.0, 0.0, 0.0)[:3]
    return lens((k1, k2, p1, p2, k3))


def _theia(tree: Node, _node: Node, item: Calibration) -> Calibration:
    items = tree["priors"].items()
    without = sum("focal_length" not in one["CameraIntrinsicsPrior"] for one in items)
    note = f"{without} of {len(items)} images state no focal length, and are left out"
    return noted(item, note) if without else item


def _gaussian_cameras(tree: Node, _context: ReadContext) -> Named:
    for node in tree.items():
        yield str(node["img_name"].value), with_more(node, {"cx": 0.0, "cy": 0.0})


KITTI_IMAGES = Option(
    name="images",
    values=("raw", "rectified"),
    meaning="whether the images are as they were taken (K and D) or rectified (P_rect)",
)
KITTI_ORIGIN = "KITTI does not document its pixel origin; OpenCV's was taken"
KITTI_RAW = "this is the camera of the raw images; --set images=rectified gives the rectified ones"
_KITTI = re.compile(r"(\w+):[ \t]*(.*)")
_RAW = re.compile(r"K_(\d\d)")
_PROJECTION = re.compile(r"P(\d)")


def _is_kitti(content: Content) -> Sniff | None:
    """The line K_00, or the lines P0 and P1 with twelve numbers each."""
    text = content.text or ""
    if "P0:" not in text and "K_" not in text:
        return None
    names = {match[1]: len(match[2].split()) for line in content.lines if (match := _KITTI.fullmatch(line))}
    raw = next((name for name in names if _RAW.fullmatch(name)), None)
    if raw is not None and {f"S_{raw[2:]}", f"D_{raw[2:]}"} <= names.keys():
        return Sniff(Sure.MAGIC, f"the lines S_{raw[2:]}, {raw} and D_{raw[2:]}")
    if names.get("P0") == names.get("P1") == 12:
        return Sniff(Sure.SHAPE, "the lines P0 and P1 with twelve numbers each")
    return None


def _kitti_cameras(tree: Node, context: ReadContext) -> Named:
    """Every camera by its number."""
    images = context.option(KITTI_IMAGES.name)
    raw = [match[1] for name, _ in tree.entries() if (match := _RAW.fullmatch(name))]
    for number in raw:
        if images == "rectified":
            yield number, _kitti_rectified(tree, f"P_rect_{number}", f"S_rect_{number}")
            continue
        K, D = (_row_of(tree, f"{key}_{number}", count) for key, count in (("K", 9), ("D", 5)))
        size, kind = _row_of(tree, f"S_{number}", 2), "raw beside" if f"P_rect_{number}" in tree else "raw"
        yield (
            number,
            Node({"K": K, "D": D, "size": size, "kind": kind}, source=tree.source, place=f"K_{number}"),
        )
    rectified = [match[1] for name, _ in tree.entries() if not raw and (match := _PROJECTION.fullmatch(name))]
    if not raw and not rectified:
        tree.fail("there is neither a K_00 nor a P0")
    if rectified and images == "raw":
        raise InputError(
            "the file knows the rectified images only; the raw ones are in calib_cam_to_cam.txt",
            source=tree.source,
        )
    yield from ((number, _kitti_rectified(tree, f"P{number}", "")) for number in rectified)


def _kitti_rectified(tree: Node, name: str, size: str) -> Node:
    P = _row_of(tree, name, 12)
    if P[4] != 0 or P[8:11] != [0, 0, 1]:
        tree[name].fail("this is not a projection matrix of a rectified camera")
    K = [*P[:3], *P[4:7], *P[8:11]]
    more: dict[str, Json] = {"size": _row_of(tree, size, 2)} if size else {}
    return Node({"K": K, "kind": "rectified", **more}, source=tree.source, place=name)


def _row_of(tree: Node, name: str, count: int) -> list[Json]:
    return [*strict.numbers(tree[name].text(), count=count, source=tree.source, place=name)]


def _kitti(tree: Node, node: Node, item: Calibration) -> Calibration:
    date = find(tree, "calib_time")
    item = replace(
        item, provenance=replace(item.provenance, date=None if date is None else date.text() or None)
    )
    return noted(item, KITTI_ORIGIN, *((KITTI_RAW,) if node["kind"].value == "raw beside" else ()))


P_LONGEST = 4000
P_NOTE = "K was decomposed from a projection matrix; the pose in it was left alone"
P_BARE = "a bare matrix does not say how it came about; taken as derived"
SMALLEST_FOCAL_PX = 2.0
"""A pose by itself, [R | t], decomposes into a K with focal lengths of 1."""
SINGULAR = 1e-12


def _is_projection(content: Content) -> Sniff | None:
    rows = numbers_of(content.lines) if len(content.data) <= P_LONGEST and len(content.lines) == 3 else None
    if rows is None or [*map(len, rows)] != [4, 4, 4]:
        return None
    return Sniff(Sure.WEAK, "it is three rows of four numbers, as a projection matrix")


def _projection(data: bytes, context: ReadContext) -> Node:
    rows = [row for row in text_of(data, most=P_LONGEST).splitlines() if row.strip()]
    if len(rows) != 3:
        raise ParseError(f"{len(rows)} rows of numbers, expected 3")
    fx, fy, cx, cy, skew = of_projection([strict.numbers(row, count=4) for row in rows])
    return document_of(context, K=[fx, fy, cx, cy, skew])


def of_projection(P: Sequence[Sequence[float]], place: str | None = None) -> tuple[float, ...]:
    """fx, fy, cx, cy and the skew of K, in px, of P = K·[R | t] up to a factor.

    Rows and columns in reverse turn RQ into numpy's QR. A sign of P as a whole, and a mirrored world, end up
    in R.

    Raises:
        ParseError: its left 3×3 part is singular, or K is not in px.
    """
    M = np.array(P)[:, :3]
    scale = float(np.abs(M).max())
    if not scale > 0 or np.linalg.svd(M / scale, compute_uv=False)[-1] < SINGULAR:
        raise ParseError(
            "its left 3×3 part has no inverse, so it is not a camera at a finite place", place=place
        )
    reversed_rows = np.linalg.qr((M / scale)[::-1].T)[1]
    upper = reversed_rows.T[::-1, ::-1]
    upper = upper * np.sign(np.diag(upper))
    (fx, skew, cx), (_, fy, cy), _ = (upper / upper[2, 2]).tolist()
    if not min(fx, fy) >= SMALLEST_FOCAL_PX:
        raise ParseError(
            f"it decomposes into focal lengths of {fx:.3g} and {fy:.3g}, which are not in px: this is a "
            "pose or a normalised matrix, expected P = K·[R | t]",
            place=place,
        )
    return fx, fy, cx, cy, skew


ROWS: Final = (
    Program(
        name="argoverse",
        title="Argoverse vehicle calibration",
        words="""\
Argoverse's ``vehicle_calibration_info.json``: the cameras of a car, seven around and two ahead.

In the format's own words::

    {"camera_data_": [{"key": "image_raw_ring_front_center", "value": {
        "focal_length_x_px_": 1392.1, "focal_length_y_px_": 1392.1, "focal_center_x_px_": 980.1,
        "focal_center_y_px_": 604.3, "skew_": 0.0, "distortion_coefficients_": [-0.17, 0.12, -0.03],
        "vehicle_SE3_camera_": {…}}}, …]}

The three coefficients are k1, k2, k3 of OpenCV's polynomial. A camera whose key ends in ``_rect`` is of rectified
images, which have no distortion: the program projects into them with K alone, and the coefficients beside it are those
of the raw images. The file does not state image sizes: the data set's are
1920×1200 around the car and 2464×2056 ahead.

Source: argoverse-api, ``argoverse/utils/calibration.py``: ``CameraConfig`` ("distortion_coeffs: k1, k2, k3"),
``load_stereo_calib`` and ``project_cam_to_image`` for rectified ones; ``argoverse/utils/camera_stats.py``: the sizes.
""",
        suffixes=(".json",),
        reference="https://github.com/argoverse/argoverse-api",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            coefficients=("k1", "k2", "k3"),
            remarks=("the image sizes are those of the data set, by the cameras' names",),
        ),
        marks=(Mark(("camera_data_",)),),
        cameras=_argoverse_cameras,
        K=ARGOVERSE_K,
        size=("size",),
        model=("kind",),
        models={"raw": Model(radial, ("distortion_coefficients_",), (3,)), "rectified": Model()},
        finish=_argoverse,
    ),
    Program(
        name="gaussian_cameras",
        title="3D Gaussian splatting cameras.json",
        words="""\
``cameras.json`` of 3D Gaussian splatting: the undistorted camera of every image of a scene.

In the format's own words::

    [{"id": 0, "img_name": "00001", "width": 1959, "height": 1090, "position": […], "rotation": […],
      "fy": 1164.6, "fx": 1159.5}, …]

The training's images are undistorted and their principal point in the middle: it goes by the field of view alone.
Images whose numbers are the same are one camera.

Source: gaussian-splatting, ``utils/camera_utils.py``, ``camera_to_JSON``.
""",
        suffixes=(".json",),
        reference="https://github.com/graphdeco-inria/gaussian-splatting",
        convention=Convention(
            origin=Origin.IMAGE_CENTRE,
            tangential=Tangential.NONE,
            remarks=("undistorted images; the principal point is in the middle",),
        ),
        marks=(Mark(("img_name", "width", "height", "fx", "fy", "rotation"), at="[0]"),),
        cameras=_gaussian_cameras,
        K=("fx", "fy", "cx", "cy"),
        grade=Grade.ADJUSTED,
        assumptions=(
            "the file has no principal point; the program renders with it in the middle of the image",
        ),
        is_of_images=True,
    ),
    Program(
        name="kitti",
        title="KITTI calibration",
        words="""\
KITTI's calibration files: ``calib_cam_to_cam.txt`` of the raw recordings, ``calib.txt`` of the benchmarks.

In the format's own words::

    calib_time: 09-Jan-2012 13:57:47
    S_00: 1392 512                    size of the images as they were taken
    K_00: 984.2 0 690.0 0 980.8 233.2 0 0 1
    D_00: -0.3728 0.2037 0.0022 0.0014 -0.0723        k1 k2 p1 p2 k3
    R_00: … T_00: …
    S_rect_00: 1242 375               size after rectification
    R_rect_00: …
    P_rect_00: 721.5 0 609.6 0 0 721.5 172.9 0 0 0 1 0

The benchmarks' images are rectified, and their ``calib.txt`` has the projection matrices P0 … P3 alone, without
the size of the images. In a rectified camera's P, K is the left 3×3.

The pixel origin is not documented. It is read as OpenCV's, because the distortion model is OpenCV's.

Source: A. Geiger et al., "Vision meets robotics: the KITTI dataset", 2013, and the development kit's readme.
""",
        suffixes=(".txt",),
        reference="https://www.cvlibs.net/datasets/kitti/raw_data.php",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=OPENCV_ORDER[:5],
            remarks=("the origin is not documented; OpenCV's was taken",),
        ),
        recognise=_is_kitti,
        load=lambda data, context: keyed(data, context.name, sign=":"),
        cameras=_kitti_cameras,
        K="K",
        size=("size",),
        model=("kind",),
        models={
            "raw": Model(lens, ("D",)),
            "raw beside": Model(lens, ("D",)),
            "rectified": Model(),
        },
        is_always_named=True,
        finish=_kitti,
        states=("date",),
        options=(KITTI_IMAGES,),
    ),
    Program(
        name="llff_npy",
        title="LLFF poses_bounds.npy",
        words="""\
``poses_bounds.npy`` of LLFF, which NeRF and its descendants read: pose, size, focal length and depths of each image.

In the format's own words::

    N×17 numbers: a 3×5 matrix by rows, [R | t | (height, width, focal)], then the nearest and the farthest depth

One focal length for both axes, and the principal point in the middle of the image. COLMAP solved for it, mostly with a
radial distortion, which the file does not keep: the distortion is unknown.

Source: LLFF, README "Using your own poses without running COLMAP"; ``llff/poses/pose_utils.py``, ``save_poses``.
""",
        suffixes=(".npy",),
        reference="https://github.com/Fyusion/LLFF",
        convention=Convention(
            origin=Origin.IMAGE_CENTRE,
            tangential=Tangential.NONE,
            remarks=("one focal length, and the principal point in the middle of the image",),
        ),
        recognise=_is_llff,
        load=_llff,
        cameras=_counted,
        K=("K",),
        size=("size",),
        models=UNKNOWN_LENS,
        grade=Grade.ADJUSTED,
        most=MOST_IMAGES,
        finish=_viewed,
    ),
    Program(
        name="mvsnet_cam",
        title="MVSNet camera (_cam.txt)",
        words="""\
MVSNet's ``_cam.txt``, one for each image, which its many descendants and BlendedMVS share.

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
""",
        suffixes=(".txt",),
        reference="https://github.com/YoYo000/MVSNet",
        convention=Convention(
            origin=Origin.CORNER,
            tangential=Tangential.NONE,
            remarks=(
                "undistorted images",
                "the origin is MVSNet's own; its PyTorch descendants count from the pixel's centre",
            ),
        ),
        recognise=_is_mvsnet,
        load=_mvsnet,
        K="intrinsic",
        asks_origin=True,
        size=(),
        grade=Grade.ADJUSTED,
    ),
    Program(
        name="named_pinholes",
        title="ScanNet scene and Middlebury stereo calibration (.txt)",
        words="""\
ScanNet's ``sceneXXXX_XX.txt`` and Middlebury's ``calib.txt``: pinholes among a scene's numbers, name by name.

In the formats' own words::

    colorHeight = 968                                   ScanNet
    colorWidth = 1296
    fx_color = 1170.187988                              and fx_depth …, depthWidth …
    fy_color = 1170.187988
    mx_color = 647.750000
    my_color = 483.750000

    cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]      Middlebury 2014 and 2021
    cam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]
    doffs=131.111
    width=2964
    height=1988

Middlebury's images are rectified; ``doffs`` is cx1 − cx0, so that a depth is baseline · f / (disparity + doffs),
wherever cx counts from. ScanNet's colour images have a distortion that this file does not state. Where the principal
points count from is stated by neither.

Sources: ScanNet, ``SensReader`` and README; D. Scharstein et al., "High-resolution stereo datasets", 2014, "Calibration
file format".
""",
        suffixes=(".txt",),
        reference="https://vision.middlebury.edu/stereo/data/scenes2014/",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            remarks=(
                "Middlebury's images are rectified",
                "the origin is not stated",
            ),
        ),
        recognise=_is_named,
        load=_named,
        cameras=_named_cameras,
        K=("K",),
        asks_origin=True,
        size=("size",),
        model=("kind",),
        models={"": Model(lambda _: None), "rectified": Model(K="K")},
    ),
    Program(
        name="neus_npz",
        title="NeuS and IDR cameras (cameras_sphere.npz)",
        words="""\
``cameras_sphere.npz`` and ``cameras.npz`` of IDR, NeuS and their descendants: a projection matrix for each image.

In the format's own words::

    world_mat_0   4×4    K·[R | t] in its first three rows, for pixels
    scale_mat_0   4×4    takes the unit sphere to the object
    world_mat_1 …

calibrary decomposes each matrix into K, as the programs do with ``cv2.decomposeProjectionMatrix``; images whose K agree
are one camera. Pixels are counted by whole numbers, 0 being the first. ``camera_mat_0``, if it is there, is no K. The
file states neither image size nor distortion.

Sources: IDR, ``code/utils/rend_util.py``, ``load_K_Rt_from_P``; NeuS, ``models/dataset.py``, ``gen_rays_at``.
""",
        suffixes=(".npz",),
        reference="https://github.com/lioryariv/idr/blob/main/DATA_CONVENTION.md",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            remarks=("K comes from an RQ decomposition; the file contains no distortion and no image size",),
        ),
        recognise=_is_neus,
        load=_neus,
        cameras=_counted,
        K=("K[0:1]", "K[1:2]", "K[2:3]", "K[3:4]", "K[4:]"),
        size=(),
        models=UNKNOWN_LENS,
        grade=Grade.DERIVED,
        assumptions=(ORIGIN_UNKNOWN,),
        most=MOST_IMAGES,
        finish=_viewed,
    ),
    Program(
        name="nsvf_intrinsics",
        title="NSVF, SRN and DeepVoxels intrinsics.txt",
        words="""\
``intrinsics.txt`` of NSVF, SRN, DeepVoxels and pixelNeRF scenes.

In the format's own words::

    1111.111 400 400 0.            f cx cy 0, or fx fy cx cy
    0. 0. 0.                       the scene's centre
    0.                             near plane, absent in some
    1.                             scale
    800 800                        height width

The scenes are rendered or undistorted, so there is no distortion. Where cx and cy count from is not stated; half the
image's side, which most files have, is the middle counted from the corner.

Source: scene-representation-networks, ``util.py``, ``parse_intrinsics``; NSVF, ``fairnr/data/data_utils.py``.
""",
        suffixes=(".txt",),
        reference="https://github.com/facebookresearch/NSVF",
        convention=Convention(
            origin=Origin.CORNER,
            tangential=Tangential.NONE,
            remarks=(
                "height comes before width",
                "the origin is not stated",
            ),
        ),
        recognise=_is_nsvf,
        load=_nsvf,
        K=("K",),
        asks_origin=True,
        size=("size",),
    ),
    Program(
        name="nuscenes",
        title="nuScenes calibrated_sensor.json",
        words="""\
nuScenes' ``calibrated_sensor.json``: the cameras of every vehicle's calibration, among its other sensors.

In the format's own words::

    [{"token": "75ad8e2a8a3f4594a13db2398430d097", "sensor_token": "ec4b5d41…", "translation": […], "rotation": […],
      "camera_intrinsic": [[1262.8, 0.0, 786.7], [0.0, 1262.8, 437.9], [0.0, 0.0, 1.0]]},
     {"token": "…", "camera_intrinsic": []}, …]

A lidar or radar has an empty matrix. "All camera images come undistorted and rectified"; their size is in another
table.

Source: nuScenes, ``docs/schema_nuscenes.md``, "calibrated_sensor".
""",
        suffixes=(".json",),
        reference="https://www.nuscenes.org/nuscenes#data-format",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            remarks=(
                "undistorted images",
                "the origin is not stated",
            ),
        ),
        marks=(Mark(("camera_intrinsic", "sensor_token"), at="[0]"),),
        cameras=_nuscenes_cameras,
        K="camera_intrinsic",
        asks_origin=True,
        size=(),
        most=MOST_IMAGES,
    ),
    Program(
        name="open3d",
        title="Open3D camera and trajectory",
        words="""\
Open3D's ``PinholeCameraIntrinsic`` and ``PinholeCameraTrajectory`` in JSON.

In the format's own words::

    {"width": 640, "height": 480, "intrinsic_matrix": [621.4, 0, 0,  0, 621.4, 0,  313.7, 240.0, 1]}
    {"class_name": "PinholeCameraTrajectory", "parameters": [{"intrinsic": {…}, "extrinsic": […]}, …]}
    {"class_name": "PinholeCameraParameters", "intrinsic": {…}, "extrinsic": […]}

The matrix is Eigen's, column by column. A trajectory has a camera for each image; those with the same numbers are one.
Open3D projects pixel (u, v) of an image by u = fx·x/z + cx with whole numbers at the pixels' centres, and knows no
distortion: its images are undistorted, or nobody took care, so the distortion is unknown.

Sources: Open3D, ``cpp/open3d/camera/PinholeCameraIntrinsic.cpp``, ``ConvertToJsonValue``;
``geometry/PointCloudFactory.cpp``.
""",
        suffixes=(".json",),
        reference="https://www.open3d.org/docs/release/python_api/open3d.camera.PinholeCameraIntrinsic.html",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            remarks=("the matrix is written column by column", "no distortion"),
        ),
        marks=(
            Mark(("width", "height", "intrinsic_matrix"), holds=_runs_down_columns),
            *(
                Mark(("class_name",), words=(f'"PinholeCamera{kind}"',))
                for kind in ("Trajectory", "Parameters")
            ),
        ),
        cameras=_open3d_cameras,
        K="intrinsic_matrix",
        is_transposed=True,
        models={"": Model(lambda _: None)},
        grade=Grade.DERIVED,
        assumptions=(ORIGIN_UNKNOWN,),
        is_of_images=True,
        finish=_open3d,
    ),
    Program(
        name="openmvg",
        title="OpenMVG sfm_data.json",
        words="""\
OpenMVG's ``sfm_data.json``: cameras among views and poses, as the serialisation library cereal writes them.

In the format's own words::

    {"sfm_data_version": "0.3", "views": […], "intrinsics": [{"key": 0, "value": {
       "polymorphic_id": 2147483649, "polymorphic_name": "pinhole_radial_k3",
       "ptr_wrapper": {"id": 2147483660, "data": {"width": 4000, "height": 3000, "focal_length": 2856.4,
         "principal_point": [1992.3, 1520.1], "disto_k3": [-0.02, 0.01, 0.0]}}}}], "extrinsics": […]}

cereal names a class once: later cameras of the class have only its number, ``polymorphic_id``, without the high
bit; and a camera that occurs twice has its ``data`` once. There is one focal length, in pixels. ``disto_t2`` of
``pinhole_brown_t2`` is k1 k2 k3 t1 t2 with OpenCV's p1, p2 as t1, t2; ``fisheye`` is OpenCV's. Whether pixels
count from their corners or centres is not documented: these are read as OpenCV's.

Without extrinsics nothing has been adjusted, and the camera comes only from EXIF and a table of sensors.

Sources: OpenMVG, ``src/openMVG/cameras`` and its documentation, "SfM data format".
""",
        suffixes=(".json",),
        reference="https://openmvg.readthedocs.io/en/latest/software/SfM/SfM_OutputFormat/",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=("k1", "k2", "k3", "t1", "t2"),
            remarks=(
                "one focal length",
                "the origin is not documented: it is read as the centre of the top-left pixel",
            ),
        ),
        marks=(Mark(("sfm_data_version",)),),
        cameras=_openmvg_cameras,
        K=("focal_length", "focal_length", "principal_point"),
        model=("kind",),
        models=OPENMVG,
        grade=Grade.ADJUSTED,
        most=1_000_000,
        finish=_openmvg,
        states=("tool",),
    ),
    Program(
        name="projection_matrix",
        title="3×4 projection matrix",
        words="""\
A 3×4 projection matrix by itself, as self-calibration and multi-view programs save it (``*.Pmat.cal``, ``.P``).

In the format's own words::

    p11 p12 p13 p14
    p21 p22 p23 p24
    p31 p32 p33 p34

with s·(u, v, 1) = P·(X, Y, Z, 1). P = K·[R | t] up to a factor, so K is the upper triangle of the decomposition M = K·R
of its left 3×3 part, made positive on the diagonal. It contains neither the lens distortion nor the image size. The
file does not state whether u and v count from the top-left pixel's centre or corner.

Source: R. Hartley and A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd ed., section 6.2.4.
""",
        suffixes=(".cal", ".p", ".txt"),
        reference="https://github.com/strawlab/MultiCamSelfCal",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            remarks=("K comes from an RQ decomposition; the file contains no distortion and no image size",),
        ),
        recognise=_is_projection,
        load=_projection,
        K=("K[0:1]", "K[1:2]", "K[2:3]", "K[3:4]", "K[4:]"),
        asks_origin=True,
        size=(),
        models=UNKNOWN_LENS,
        grade=Grade.DERIVED,
        assumptions=(P_BARE,),
        finish=lambda _tree, _node, item: noted(item, P_NOTE),
    ),
    Program(
        name="theia_priors",
        title="TheiaSfM calibration file",
        words="""\
TheiaSfM's calibration file: what is known of the cameras of a reconstruction before it begins.

In the format's own words::

    {"priors": [
        {"CameraIntrinsicsPrior": {
            "image_name": "view_1.jpg", "width": 752, "height": 480, "focal_length": 433.2, "aspect_ratio": 0.9993,
            "principal_point": [371.6, 238.3], "skew": 0.0, "camera_intrinsics_type": "PINHOLE_RADIAL_TANGENTIAL",
            "radial_distortion_coeffs": [-0.21, 0.04, 0.006], "tangential_distortion_coeffs": [-0.0004, 0.0008]}}, …]}

fy is aspect_ratio · focal_length. PINHOLE has two radial coefficients, PINHOLE_RADIAL_TANGENTIAL three and OpenCV's p1
and p2, FISHEYE the four of cv2.fisheye, FOV its angle and DIVISION_UNDISTORTION one number in pixels, which is refused.
Where the principal point counts from is not stated. Images whose numbers are the same are one camera.

Source: TheiaSfM, ``src/theia/io/read_calibration.h`` and ``sfm/camera/pinhole_radial_tangential_camera_model.h``.
""",
        suffixes=(".json", ".txt"),
        reference="https://github.com/sweeneychris/TheiaSfM",
        syntaxes=(Syntax.JSON,),
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=("k1", "k2", "k3", "p1", "p2"),
            remarks=(
                "fy is aspect_ratio times focal_length",
                "the origin is not stated",
            ),
        ),
        marks=(Mark(("CameraIntrinsicsPrior",), at="priors[0]"),),
        cameras=_theia_cameras,
        K=under("K", "fx fy cx cy skew"),
        asks_origin=True,
        model=("camera_intrinsics_type",),
        models={
            "PINHOLE": Model(_theia_lens, ("tangential", THEIA_RADIAL), (2, 3, 4), missing=0.0),
            "PINHOLE_RADIAL_TANGENTIAL": Model(
                _theia_lens, ("tangential", THEIA_RADIAL), (2, 3, 4, 5), missing=0.0
            ),
            "FISHEYE": Model(fisheye, (THEIA_RADIAL,), (4,)),
            "FOV": Model(field_of_view, (THEIA_RADIAL,), (1,)),
        },
        is_of_images=True,
        most=MOST_IMAGES,
        idle=(THEIA_RADIAL, "tangential_distortion_coeffs"),
        finish=_theia,
    ),
)
"""In alphabetical order."""
