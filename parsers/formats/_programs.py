"""The table of programs' formats: each row a K and a lens under other names, in its own words and with its source.

To add one, add its row, and its sample with the formula computed independently to the tests of the formats.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final

from calibrary.calibration import Calibration, Grade, Quality
from calibrary.distortion import Distortion, DoubleSphere, FisheyePolynomial, Unified
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import names
from calibrary.parsers import text as strict
from calibrary.parsers.content import Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential, Unit
from calibrary.parsers.document import Node
from calibrary.parsers.format import ReadContext, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN, fisheye, refuse_model
from calibrary.parsers.formats._opencv_lens import COUNTS, OPENCV_ORDER, lens, smallest_lens
from calibrary.parsers.formats._robots import ROBOTS
from calibrary.parsers.formats._scenes import SCENES
from calibrary.parsers.formats._table import (
    Mark,
    Model,
    Named,
    Program,
    at,
    double_sphere,
    everywhere,
    extended_unified,
    field_of_view,
    find,
    listed,
    noted,
    numbers_at,
    under,
    unified,
    with_more,
)
from calibrary.parsers.names import simplified
from calibrary.records import replace

JSON, YAML, XML = (Syntax.JSON,), (Syntax.TEXT,), (Syntax.XML,)
FOUR = "a fisheye's four are k1, k2, k3, k4"
BROWN4, FISHEYE4 = ("k1", "k2", "p1", "p2"), ("k1", "k2", "k3", "k4")


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


def _calib_io_cameras(tree: Node, _context: ReadContext) -> Named:
    """Only the first camera of a kind has the model's name; later ones repeat the number that it got there."""
    names: dict[int, str] = {}
    for index, node in enumerate(at(tree, "Calibration.cameras").items()):
        model = node["model"]
        # cereal sets the highest bit of a number where the name that belongs to it stands beside it.
        number = model["polymorphic_id"].whole() & ~(1 << 31)
        if "polymorphic_name" in model:
            names[number] = model["polymorphic_name"].text()
        if number not in names:
            model["polymorphic_id"].fail(f"no camera before it gave {number} a name")
        body = model["ptr_wrapper"]["data"]
        f, ratio = numbers_at(body, under("parameters", "f.val ar.val"))
        yield f"cam{index}", with_more(body, {"kind": names[number], "fy": f * ratio})


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


def _calibu_cameras(tree: Node, _context: ReadContext) -> Named:
    yield from ((f"camera {index}", node) for index, node in enumerate(everywhere(tree, "camera_model")))


def _ftc_cameras(tree: Node, _context: ReadContext) -> Named:
    for camera in everywhere(tree, "Camera"):
        for node in everywhere(camera, "Calibration"):
            yield f"{at(camera, 'vid').text()} {at(camera, 'pid').text()} {at(node, 'size').text()}", node


def _pix4d_cameras(tree: Node, _context: ReadContext) -> Named:
    """With K in px, of lengths in mm and pixels in micrometres."""
    for node in everywhere(tree, "camera"):
        pixel, f, cx, cy = numbers_at(
            node, ("pixelSize", "focalLengthmm", "principalPointXmm", "principalPointYmm")
        )
        if not pixel > 0:
            node["pixelSize"].fail(f"pixels of {pixel:g} micrometres, expected positive ones")
        mm = 1000 / pixel
        yield at(node, "name").text(), with_more(node, {"fx": f * mm, "cx": cx * mm, "cy": cy * mm})


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


def _photonvision_cameras(tree: Node, _context: ReadContext) -> Named:
    several = find(tree, "calibrations")
    for node in (tree,) if several is None else several.items():
        width, height = numbers_at(node, under("resolution", "width height"))
        yield f"{width:g}×{height:g}", node


def _photonvision(_tree: Node, node: Node, item: Calibration) -> Calibration:
    model = find(node, "lensmodel")
    if model is not None and not model.text().startswith("LENSMODEL_OPENCV"):
        refuse_model(model.text(), ("LENSMODEL_OPENCV",), place=model.place)
    errors = find(node, "perViewErrors")
    return item if errors is None else replace(item, quality=Quality(views=len(errors.items())))


def _slstudio_cameras(tree: Node, _context: ReadContext) -> Named:
    for name, keys in SLSTUDIO.items():
        yield name, Node({key: tree[key].value for key in keys if key in tree}, source=tree.source)


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


def _kinect_lens(values: Sequence[float]) -> Distortion:
    k1, k2, k3, k4, k5, k6, codx, cody, p2, p1 = values
    if codx or cody:
        raise UnsupportedModelError("the distortion has a centre of its own, which has no counterpart here")
    return lens((k1, k2, p1, p2, k3, k4, k5, k6))


def _radial(values: Sequence[float]) -> Distortion:
    k1, k2, k3 = (*values, 0.0, 0.0, 0.0)[:3]
    return lens((k1, k2, 0.0, 0.0, k3))


FIRST_OF_ITS_KIND = 0x80000000
"""cereal's high bit: what follows is new, its name or its data comes with it."""
UNNAMED = 0x40000000
"""cereal's number for an object of the very class the pointer is declared for, which has no name."""
OPENMVG_ORIGIN = (
    "OpenMVG does not state if it counts from the centre of the first pixel or its corner; the centre was "
    "assumed"
)
OPENMVG = {
    "pinhole_radial_k1": Model(_radial, ("disto_k1",), (1,)),
    "pinhole_radial_k3": Model(_radial, ("disto_k3",), (3,)),
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


MOST_OF_VIKIT = 1000
SLSTUDIO = {
    "camera": ("Kc", "kc", "frameWidth", "frameHeight"),
    "projector": ("Kp", "kp", "screenResX", "screenResY"),
}
VIKIT_K = ("cam_fx|A11", "cam_fy|A22", "cam_cx|u0", "cam_cy|v0")
VIKIT_POLYNOMIAL = Model(
    _even_polynomial, ("k2", "k3", "k4", "k5", "k6", "k7"), missing=0.0, K=(*VIKIT_K, "cam_skew|A12")
)
VIKIT_FOUR = ("cam_d0", "cam_d1", "cam_d2", "cam_d3")
MAPLAB_LENS = ("distortion.parameters",)
PLAIN = under("distortion_parameters", "k1 k2 p1 p2")
VINS_K = under("projection_parameters", "fx fy cx cy")

PROGRAMS: Final = (
    Program(
        name="anipose",
        title="Anipose calibration (TOML)",
        words="""\
Anipose's ``calibration.toml``, which aniposelib, Pose2Sim, FreeMoCap and sleap-anipose share.

In the format's own words::

    [cam_0]
    name = "1"
    size = [ 1920, 1080,]
    matrix = [ [ 1361.8, 0.0, 959.5,], [ 0.0, 1361.8, 539.5,], [ 0.0, 0.0, 1.0,],]
    distortions = [ -0.0154, 0.0, 0.0, 0.0, 0.0,]
    rotation = [ … ]
    translation = [ … ]
    fisheye = true                     # absent or false: OpenCV's own model

    [metadata]
    adjusted = false
    error = 0.633

K and the coefficients are OpenCV's; those of a fisheye are cv2.fisheye's.

Source: aniposelib, ``aniposelib/cameras.py``, ``Camera.get_dict`` and ``FisheyeCamera``.
""",
        suffixes=(".toml",),
        reference="https://anipose.readthedocs.io/en/latest/",
        syntaxes=YAML,
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER[:5], remarks=(FOUR,)),
        marks=(Mark((), inner=("matrix", "distortions", "size"), words=("[", "=")),),
        cameras=lambda tree, _: (
            (str(node.value.get("name") or key), node)
            for key, node in tree.entries()
            if isinstance(node.value, dict) and "matrix" in node
        ),
        K="matrix",
        size=("size",),
        model=("fisheye",),
        models={
            **{mark: Model(lens, ("distortions",), COUNTS) for mark in ("", "false")},
            "true": Model(fisheye, ("distortions",), (4,)),
        },
    ),
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
        syntaxes=JSON,
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
        syntaxes=JSON,
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
        name="calib_io",
        title="calib.io Camera Calibrator",
        words="""\
calib.io's Camera Calibrator, the calibration it saves as JSON.

In the format's own words::

    {"Calibration": {"cameras": [{
        "model": {"polymorphic_id": 2147483649, "polymorphic_name": "libCalib::CameraModelOpenCV",
                  "ptr_wrapper": {"valid": 1, "data": {
                      "CameraModelCRT": {"CameraModelBase": {"imageSize": {"width": 5472, "height": 3648}}},
                      "parameters": {"f": {"val": 3650.1, "state": 2}, "ar": {"val": 0.9996, "state": 2},
                                     "cx": …, "cy": …, "k1": … "k6", "p1", "p2", "s1" … "s4", "tauX", "tauY"}}}},
        "transform": …}]}}

fx = f and fy = f·ar; the coefficients are OpenCV's by name. Only the first camera of a kind has the model's name; later
ones repeat the number that it got there.

Source: calib.io, ``readCalibParameters.cpp`` (public domain); cereal's polymorphic pointers.
""",
        suffixes=(".json",),
        reference="https://calib.io/pages/camera-calibrator",
        syntaxes=JSON,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE, remarks=("fx = f, fy = f·ar", "coefficients are named as OpenCV's")
        ),
        marks=(Mark(("Calibration",), words=('"libCalib::',)),),
        cameras=_calib_io_cameras,
        K=("parameters.f.val", "fy", "parameters.cx.val", "parameters.cy.val"),
        size=under("CameraModelCRT.CameraModelBase.imageSize", "width height"),
        model=("kind",),
        models={
            "libCalib::CameraModelOpenCV": Model(
                smallest_lens,
                tuple(f"parameters.{name}.val" for name in (*OPENCV_ORDER[:12], "tauX", "tauY")),
            )
        },
    ),
    Program(
        name="calibu",
        title="Calibu camera rig (vicalib)",
        words="""\
Calibu's camera rigs (``cameras.xml``), which vicalib writes.

In the format's own words::

    <rig>
      <camera>
        <camera_model name="" index="0" serialno="0" type="calibu_fu_fv_u0_v0_k1_k2_k3" version="8">
          <width> 640 </width>
          <height> 480 </height>
          <params> [ 433.2; 432.9; 371.6; 238.3; -0.21; 0.04; 0 ] </params>
        </camera_model>
        <pose> … </pose>
      </camera>
    </rig>

The type lists the parameters: none after u0 v0 is a pinhole, k1 k2 k3 are factors of r², r⁴ and r⁶, w is the FOV
model's angle and kb4 Kannala and Brandt's four. Where u0 and v0 count from is not stated; vicalib's corners are those
of OpenCV's pixels.

Source: Calibu, ``include/calibu/cam/camera_models_*.h`` and ``src/cam/camera_xml.cpp``.
""",
        suffixes=(".xml",),
        reference="https://github.com/arpg/Calibu",
        syntaxes=XML,
        roots=("rig", "camera", "camera_model"),
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            coefficients=("k1", "k2", "k3"),
            remarks=("the model's type lists its parameters", "the origin is not stated; OpenCV's is used"),
        ),
        marks=(Mark(("camera_model", "params")),),
        cameras=_calibu_cameras,
        K=("params[0:4]",),
        model=("type",),
        models={
            f"calibu_fu_fv_u0_v0{rest}": Model(made, ("params[4:]",), (count,))
            for rest, made, count in (
                ("", lens, 0),
                ("_w", field_of_view, 1),
                ("_k1_k2", _radial, 2),
                ("_k1_k2_k3", _radial, 3),
                ("_kb4", fisheye, 4),
            )
        },
        assumptions=(
            "Calibu does not state where u0 and v0 count from; the centre of the top-left pixel was taken",
        ),
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
        syntaxes=YAML,
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
        syntaxes=JSON,
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
        name="ftc_webcams",
        title="FTC webcam calibrations",
        words="""\
The webcam calibrations of FIRST Tech Challenge's SDK, ``teamwebcamcalibrations.xml``.

In the format's own words::

    <Calibrations>
      <Camera vid="Logitech" pid="0x085C">
        <Calibration size="640 480" focalLength="602.5, 603.25" principalPoint="318.75, 241.5"
                     distortionCoefficients="0.11, -0.24, 0.001, -0.0005, 0.09, 0, 0, 0"/>

Focal lengths and principal point are px, and the coefficients are OpenCV's: k1 k2 p1 p2 k3 k4 k5 k6.

Source: FtcRobotController, ``FtcRobotController/src/main/res/xml/teamwebcamcalibrations.xml``, its comment.
""",
        suffixes=(".xml",),
        reference="https://github.com/FIRST-Tech-Challenge/FtcRobotController",
        syntaxes=XML,
        roots=("Calibrations",),
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER[:8]),
        marks=(Mark(("Calibrations", "Camera", "Calibration"), words=("focalLength", "principalPoint")),),
        cameras=_ftc_cameras,
        K=("focalLength[0:2]", "principalPoint[0:2]"),
        size=("size[0:2]",),
        models={"": Model(smallest_lens, ("distortionCoefficients[0:]",), COUNTS)},
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
        syntaxes=YAML,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=BROWN4,
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
        name="multical",
        title="multical calibration.json",
        words="""\
multical's ``calibration.json``: the cameras of a rig, each with OpenCV's model.

In the format's own words::

    {"cameras": {"cam1": {"model": "standard", "image_size": [1920, 1080],
                          "K": [[1361.8, 0, 959.5], [0, 1361.8, 539.5], [0, 0, 1]],
                          "dist": [[-0.0154, 0, 0, 0, 0]]}},
     "camera_poses": {…}, "image_sets": {…}}

``model`` says which flag ``cv2.calibrateCamera`` was given (standard, rational, thin_prism, tilted), and the number
of coefficients says the same. A fisheye is cv2.fisheye's.

Source: multical, ``multical/io/export_calib.py`` and ``multical/camera.py``.
""",
        suffixes=(".json",),
        reference="https://github.com/oliver-batchelor/multical",
        syntaxes=JSON,
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER, remarks=(FOUR,)),
        marks=(Mark(("K", "dist", "image_size"), at="cameras.*"),),
        cameras=listed("cameras"),
        K="K",
        size=("image_size",),
        model=("model",),
        models={
            **{
                name: Model(lens, ("dist",), COUNTS)
                for name in ("", "standard", "rational", "thin_prism", "tilted")
            },
            "fisheye": Model(fisheye, ("dist",), (4,)),
        },
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
        syntaxes=YAML,
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
        syntaxes=JSON,
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
        syntaxes=JSON,
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
        name="photonvision",
        title="PhotonVision camera calibration",
        words="""\
PhotonVision's camera calibration, exported as JSON, and Chameleon Vision's before it.

In the format's own words::

    {"resolution": {"width": 640.0, "height": 480.0},
     "cameraIntrinsics": {"rows": 3, "cols": 3, "type": 6, "data": [699.4, 0.0, 345.6, …]},
     "distCoeffs": {"rows": 1, "cols": 5, "type": 6, "data": [0.1438, -0.9851, -0.0182, 0.0110, 1.9833]},
     "perViewErrors": […], "standardDeviation": 0.0635, "lensmodel": "LENSMODEL_OPENCV"}

Older versions call the coefficients cameraExtrinsics, and one of them had isFisheye. The numbers are OpenCV's; the
calibrations of several resolutions are in a camera's settings under ``calibrations``. mrcal's other lens models, which
have a name under lensmodel as well, are refused.

Source: PhotonVision, ``CameraCalibrationCoefficients.java``.
""",
        suffixes=(".json",),
        reference="https://docs.photonvision.org/en/latest/docs/calibration/calibration.html",
        syntaxes=JSON,
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER[:8], remarks=(FOUR,)),
        marks=(
            Mark(("resolution", "cameraIntrinsics")),
            Mark(("resolution", "cameraIntrinsics"), at="calibrations[0]"),
        ),
        cameras=_photonvision_cameras,
        K="cameraIntrinsics",
        size=under("resolution", "width height"),
        model=("isFisheye",),
        models={
            **{mark: Model(lens, ("distCoeffs|cameraExtrinsics",), COUNTS) for mark in ("", "false")},
            "true": Model(fisheye, ("distCoeffs|cameraExtrinsics",), (4,)),
        },
        finish=_photonvision,
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
        syntaxes=XML,
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
        name="slstudio",
        title="SLStudio structured-light calibration",
        words="""\
SLStudio's ``calibration.xml``: the camera and the projector of a structured-light scanner.

In the format's own words::

    <opencv_storage>
      <Kc type_id="opencv-matrix">…</Kc>      the camera's K
      <kc type_id="opencv-matrix">…</kc>      its k1 k2 p1 p2 k3
      <Kp type_id="opencv-matrix">…</Kp>      the projector's, as a camera the other way round
      <kp type_id="opencv-matrix">…</kp>
      <Rp>…</Rp> <Tp>…</Tp>
      <frameWidth>1024</frameWidth> <frameHeight>544</frameHeight>
      <screenResX>912</screenResX> <screenResY>1140</screenResY>

Everything is OpenCV's.

Source: SLStudio, ``src/calibrator/CalibrationData.cpp``.
""",
        suffixes=(".xml",),
        reference="https://github.com/jakobwilm/slstudio",
        syntaxes=(Syntax.XML, Syntax.TEXT),
        roots=("opencv_storage",),
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER[:5]),
        marks=(Mark(("Kc", "kc", "Kp")),),
        cameras=_slstudio_cameras,
        K="Kc|Kp",
        size=("frameWidth|screenResX", "frameHeight|screenResY"),
        models={"": Model(lens, ("kc|kp",), COUNTS)},
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
        syntaxes=YAML,
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

FORMATS: Final = {row.name: row.format() for row in (*PROGRAMS, *ROBOTS, *SCENES)}
"""By name."""
