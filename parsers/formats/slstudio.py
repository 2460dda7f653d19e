"""SLStudio's ``calibration.xml``: the camera and the projector of a structured-light scanner.

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
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._one_camera import camera, native_of, opencv_lens

CONVENTION = Convention(origin=Origin.PIXEL_CENTRE, coefficients=("k1", "k2", "p1", "p2", "k3"))
DEVICES = {
    "camera": ("Kc", "kc", "frameWidth", "frameHeight"),
    "projector": ("Kp", "kp", "screenResX", "screenResY"),
}
"""Each with the keys of its K, its coefficients and its size."""


def sniff(content: Content) -> Sniff | None:
    """The container with Kc, kc and Kp."""
    keys = set(content.xml_tags if content.xml_root == "opencv_storage" else content.yaml_keys)
    if {"Kc", "kc", "Kp"} <= keys:
        return Sniff(Sure.MAGIC, "OpenCV's container with Kc, kc and Kp")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The camera, then the projector."""
    tree = storage.load(data, source=context.name)
    return [
        camera(
            context,
            CONVENTION,
            native_of(tree[K]),
            tree.image_size(width, height) if width in tree else None,
            opencv_lens(tree[k]),
            name=name,
            tag=K,
        )
        for name, (K, k, width, height) in DEVICES.items()
    ]


FORMAT = Format(
    name="slstudio",
    title="SLStudio structured-light calibration",
    suffixes=(".xml",),
    syntaxes=(Syntax.XML, Syntax.TEXT),
    roots=("opencv_storage",),
    reference="https://github.com/jakobwilm/slstudio",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
