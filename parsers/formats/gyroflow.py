"""Gyroflow's lens profiles: fisheye calibrations of video modes, made by users who had such a camera.

In the format's own words::

    {"camera_brand": "DJI", "camera_model": "Air 3", "lens_model": "24 mm", "camera_setting": "4k",
     "calib_dimension": {"w": 3840, "h": 2160}, "num_images": 12, "input_horizontal_stretch": 1.0,
     "fisheye_params": {"RMS_error": 0.97, "camera_matrix": [[2801.4, 0.0, 1926.4], …],
                        "distortion_coeffs": [0.62, -1.83, 6.82, -8.05]}}

K is OpenCV's, in pixels of ``calib_dimension``, and the coefficients are ``cv2.fisheye``'s. Profiles of one model and
mode differ by several percent, because video modes crop and stabilise the frame in ways that the profile does not
state. calibrary therefore reads a profile as a start value for cameras of this type, never as the calibration of one. A
``distortion_model`` of another kind and a ``digital_lens`` have no counterpart here. Without ``distortion_coeffs`` a
profile would mean an equidistant fisheye, so calibrary does not write a camera whose distortion is unknown.

Source: Gyroflow, ``src/core/lens_profile.rs``, whose fields all have defaults.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Quality
from calibrary.distortion import KannalaBrandt
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats._json_text import loaded

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    coefficients=("k1", "k2", "k3", "k4"),
    remarks=("a profile describes a type of camera, so it is never more than a prior",),
)
FISHEYE = "opencv_fisheye"
TOOL = "Gyroflow "
STRETCHES = ("input_horizontal_stretch", "input_vertical_stretch")
NOTE = "a profile of this kind of camera and mode, not of one camera; such profiles differ by several percent"


def sniff(content: Content) -> Sniff | None:
    """Two keys that no other format combines."""
    if {"fisheye_params", "calib_dimension"} <= set(content.json_keys):
        return Sniff(Sure.MAGIC, "JSON with fisheye_params and calib_dimension")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the profile."""
    document = loaded(data, context)
    _refuse(document)
    size = context.size(document["calib_dimension"].image_size("w", "h"))
    params = document["fisheye_params"]
    matrix = params["camera_matrix"]
    native = Native.of_matrix(matrix.matrix(3, 3), place=matrix.place, source=matrix.source)
    intrinsics: Intrinsics = CONVENTION.intrinsics(native, size)
    k1, k2, k3, k4 = params["distortion_coeffs"].numbers(4)
    rms = params.get("RMS_error")
    views = document.get("num_images")
    return [
        Calibration(
            camera=CameraKey(
                make=_text(document, "camera_brand"),
                model=_text(document, "camera_model"),
                lens=_text(document, "lens_model"),
                capture_mode=_text(document, "camera_setting"),
                image_size=size,
            ),
            intrinsics=intrinsics,
            distortion=KannalaBrandt(k1=k1, k2=k2, k3=k3, k4=k4),
            grade=Grade.PRIOR,
            quality=Quality(
                rms_px=None if rms is None else rms.number(),
                views=None if views is None else views.whole(),
            ),
            provenance=context.provenance(
                date=_text(document, "date"),
                tool=_tool(_text(document, "calibrator_version")),
                operator=_text(document, "calibrated_by"),
            ),
            notes=(NOTE,),
        )
    ]


def _tool(version: str | None) -> str | None:
    """The program: a bare version is Gyroflow's own."""
    return f"{TOOL}{version}" if version and version[0].isdigit() else version


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """One profile, in the order of Gyroflow's own fields; what is not known is left out."""
    [calibration] = calibrations
    K, camera = calibration.intrinsics, calibration.camera
    native, quality, provenance = CONVENTION.native(K), calibration.quality, calibration.provenance
    size = dict(zip(("w", "h"), K.image_size, strict=True))
    lens = calibration.distortion
    known: dict[str, object] = {
        "camera_brand": camera.make,
        "camera_model": camera.model,
        "lens_model": camera.lens,
        "camera_setting": camera.capture_mode,
        "calib_dimension": size,
        "orig_dimension": size,
        "input_horizontal_stretch": 1.0,
        "input_vertical_stretch": 1.0,
        "num_images": quality.views if quality is not None else None,
        "calibrated_by": provenance.operator,
        "calibrator_version": provenance.tool.removeprefix(TOOL) if provenance.tool else None,
        "date": provenance.date,
    }
    params: dict[str, object] = {
        "RMS_error": quality.rms_px if quality is not None else None,
        "camera_matrix": [[native.fx, native.skew, native.cx], [0.0, native.fy, native.cy], [0.0, 0.0, 1.0]],
        "distortion_coeffs": list(lens.coefficients.values()) if lens is not None else [],
    }
    kept = {key: value for key, value in known.items() if value is not None}
    kept["fisheye_params"] = {key: value for key, value in params.items() if value is not None}
    return (json.dumps(kept, indent=2, ensure_ascii=False) + "\n").encode()


def _refuse(document: Node) -> None:
    """What makes the numbers mean something else.

    Raises:
        UnsupportedModelError: one of those things.
    """
    for key in ("distortion_model", "digital_lens"):
        node = document.get(key)
        if node is not None and node.value not in ("", FISHEYE):
            raise UnsupportedModelError(
                f"{key} is {strict.shown(node.text())}, which has no counterpart here; expected {FISHEYE} alone",
                source=document.source,
            )
    for key in STRETCHES:
        node = document.get(key)
        if node is not None and node.number() != 1.0:
            raise UnsupportedModelError(
                f"{key} is {node.number():g}: the profile is of an anamorphic lens, and the file does not state its "
                "frame",
                source=document.source,
            )


def _text(document: Node, key: str) -> str | None:
    node = document.get(key)
    return None if node is None else node.text().strip() or None


FORMAT = Format(
    name="gyroflow",
    title="Gyroflow lens profile",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/gyroflow/lens_profiles",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(KannalaBrandt,), skew=True, unknown_lens=UnknownLens.NEVER),
    states=("date", "tool", "operator"),
)
