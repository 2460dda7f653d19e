"""The ASL dataset format's ``sensor.yaml``, which came with the EuRoC recordings.

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

The numbers are Kalibr's, the names of the models are not.

Source: ETH Zürich ASL, "The EuRoC MAV datasets", ``dataset_tools``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.distortion import Distortion, KannalaBrandt
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._opencv_lens import lens

__all__ = ["FORMAT"]

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2"),
    remarks=("equidistant's four are k1, k2, k3, k4",),
)


def sniff(content: Content) -> Sniff | None:
    """The keys sensor_type and camera_model."""
    if {"sensor_type", "camera_model"} <= set(content.yaml_keys):
        return Sniff(Sure.MAGIC, "the keys sensor_type and camera_model")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file."""
    tree = storage.load(data, source=context.name)
    width, height = tree["resolution"].numbers(2)
    size = context.size(strict.image_size(width, height, source=context.name, place="resolution"))
    fu, fv, cu, cv = tree["intrinsics"].numbers(4)
    return [
        Calibration(
            camera=CameraKey(image_size=size),
            intrinsics=CONVENTION.intrinsics(Native(fx=fu, fy=fv, cx=cu, cy=cv), size, source=context.name),
            distortion=_distortion(tree),
            grade=Grade.CALIBRATED,
            provenance=context.provenance(),
        )
    ]


def _distortion(tree: Node) -> Distortion:
    if tree["camera_model"].text() != "pinhole":
        _refuse(tree["camera_model"], "pinhole")
    kind = tree["distortion_model"]
    if kind.text() == "none":
        return lens(())
    if kind.text() not in {"radial-tangential", "equidistant"}:
        _refuse(kind, "radial-tangential or equidistant")
    values = tree["distortion_coefficients"].numbers(4)
    if kind.text() == "equidistant":
        return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=True)))
    return lens(values)


def _refuse(node: Node, wanted: str) -> None:
    raise UnsupportedModelError(
        f"the model is {strict.shown(node.text())}, which has no counterpart here; expected {wanted}",
        source=node.source,
        place=node.place,
    )


FORMAT = Format(
    name="euroc",
    title="EuRoC/ASL sensor.yaml",
    suffixes=(".yaml",),
    reference="https://projects.asl.ethz.ch/datasets/doku.php?id=kmavvisualinertialdatasets",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
