"""orthority's interior parameters, which simple-ortho wrote as well: a camera for orthorectification.

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
"""

from __future__ import annotations

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import Distortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN, camera, fisheye, refuse_model, size_of
from calibrary.parsers.formats._opencv_lens import smallest_lens
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.IMAGE_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty"),
    remarks=(
        "lengths are in the unit of sensor_size, or the image's width without it",
        "cx and cy are fractions of the longer side, and coefficients are named",
    ),
)
LENSES = {
    "pinhole": (),
    "brown": CONVENTION.coefficients[:5],
    "opencv": CONVENTION.coefficients,
    "fisheye": ("k1", "k2", "k3", "k4"),
}
MAX_CAMERAS = 1000


def sniff(content: Content) -> Sniff | None:
    """The keys im_size and focal_len under a camera's name."""
    if "im_size" not in (content.text or ""):
        return None
    keys = {line.partition(":")[0] for line in content.lines}
    if not content.xml_tags and {"type", "im_size", "focal_len"} <= keys:
        return Sniff(Sure.MAGIC, "the keys type, im_size and focal_len")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the file's order."""
    tree = storage.load(data, source=context.name)
    if "im_size" in tree:
        return [_camera(tree, context, None)]
    if len(tree.keys()) > MAX_CAMERAS:
        tree.fail(f"{len(tree.keys())} cameras, expected at most {MAX_CAMERAS}")
    several = len(tree.keys()) > 1
    return [_camera(node, context, name if several else None) for name, node in tree.entries()]


def _camera(node: Node, context: ReadContext, name: str | None) -> Calibration:
    kind = node["type"].text()
    if kind not in LENSES:
        refuse_model(kind, tuple(LENSES), place=node.place)
    width, height = size = size_of(node["im_size"])
    focal = node["focal_len"]
    fx, fy = focal.numbers(2) if isinstance(focal.value, list) else (focal.number(),) * 2
    sensor = node.get("sensor_size")
    if sensor is None:
        fx, fy = fx * width, fy * width
    else:
        sensor_width, sensor_height = sensor.numbers(2)
        if min(sensor_width, sensor_height) <= 0:
            sensor.fail("the sensor's size is not positive")
        fx, fy = fx * width / sensor_width, fy * height / sensor_height
    native = Native(fx=fx, fy=fy, cx=_or_zero(node, "cx") * max(size), cy=_or_zero(node, "cy") * max(size))
    item = camera(
        context,
        CONVENTION,
        native,
        size,
        _lens(node, kind),
        name=name,
        tag=node.place,
        assumptions=(ORIGIN_UNKNOWN,),
    )
    return replace(item, grade=Grade.DERIVED)


def _lens(node: Node, kind: str) -> Distortion:
    values = [_or_zero(node, key) for key in LENSES[kind]]
    return fisheye(values) if kind == "fisheye" else smallest_lens(values)


def _or_zero(node: Node, key: str) -> float:
    found = node.get(key)
    return 0.0 if found is None else found.number()


FORMAT = Format(
    name="orthority",
    title="orthority interior parameters",
    suffixes=(".yaml", ".yml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://orthority.readthedocs.io/en/stable/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    idle=("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"),
)
