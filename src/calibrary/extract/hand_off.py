"""K as the solvers want it: files and command lines, each in its own pixel origin.

COLMAP counts from the outer corner as calibrary does; ``PINHOLE`` wants undistorted images, ``OPENCV`` and
``FULL_OPENCV`` take the distortion along (COLMAP's documentation of camera models). OpenSfM and ODM count
from the middle of the image in units of its longer side. OpenCV counts from the centre of the first pixel.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.conventions import Origin, file_from_canonical
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import UnsupportedModelError
from calibrary.evidence.context import Scene
from calibrary.evidence.metadata import ImageMetadata

__all__ = ["HandedOver", "Solver", "colmap_camera", "hand_off", "seed_command"]


class Solver(StrEnum):
    """Who the K is handed to."""

    COLMAP = "colmap"
    OPENSFM = "opensfm"
    ODM = "odm"
    OPENCV = "opencv"
    NONE = "none"


@dataclass(frozen=True, slots=True, kw_only=True)
class HandedOver:
    """One camera on its way to a solver.

    Attributes:
        slug: its name in file names.
        calibration: its K, one that may be used.
        metadata: of its images; some solvers name a camera after their own reading of EXIF.
        names: its images, relative to the image directory.
    """

    slug: str
    calibration: Calibration
    metadata: ImageMetadata
    names: tuple[str, ...]


def hand_off(solver: Solver, cameras: Sequence[HandedOver]) -> dict[str, bytes]:
    """The files one solver needs, by name; none without a camera.

    Raises:
        UnsupportedModelError: the solver has no model that is exactly a camera's.
    """
    if solver is Solver.NONE or not cameras:
        return {}
    if solver is Solver.COLMAP:
        lists = {f"colmap.{c.slug}.txt": "".join(f"{n}\n" for n in c.names).encode() for c in cameras}
        return {"colmap.sh": _colmap_script(cameras).encode(), **lists}
    if solver is Solver.OPENSFM:
        # "all" is the one name that cannot miss; with several cameras each goes by OpenSfM's own name for it.
        names = ["all"] if len(cameras) == 1 else [f"v2 {_opensfm_name(c, 'perspective')}" for c in cameras]
        models = [_opensfm(c.calibration) for c in cameras]
        return {"camera_models_overrides.json": _json(dict(zip(names, models, strict=True)))}
    if solver is Solver.ODM:
        return {"cameras.json": _json({_opensfm_name(c, "brown"): _odm(c.calibration) for c in cameras})}
    files = {f"{camera.slug}.opencv.yml": camera.calibration for camera in cameras}
    return {name: parsers.encode([K], "opencv_storage", name=name)[0] for name, K in files.items()}


def colmap_camera(calibration: Calibration) -> tuple[str, list[float]]:
    """COLMAP's model name and parameters, in COLMAP's order.

    Raises:
        UnsupportedModelError: COLMAP has no model that is exactly this distortion.
    """
    K, d = calibration.intrinsics, calibration.distortion
    if K.skew:
        raise UnsupportedModelError(f"COLMAP's models have no skew, this K has {K.skew:g} px")
    pinhole = [K.fx, K.fy, K.cx, K.cy]
    if d is None or isinstance(d, NoDistortion):
        return "PINHOLE", pinhole
    if isinstance(d, BrownConrady):
        if d.k3 == 0:
            return "OPENCV", [*pinhole, d.k1, d.k2, d.p1, d.p2]
        return "FULL_OPENCV", [*pinhole, d.k1, d.k2, d.p1, d.p2, d.k3, 0.0, 0.0, 0.0]
    if isinstance(d, Rational):
        return "FULL_OPENCV", [*pinhole, d.k1, d.k2, d.p1, d.p2, d.k3, d.k4, d.k5, d.k6]
    if isinstance(d, KannalaBrandt):
        return "OPENCV_FISHEYE", [*pinhole, d.k1, d.k2, d.k3, d.k4]
    raise UnsupportedModelError(f"COLMAP has no model that is exactly {d.model!r}")


def seed_command(seed: Calibration) -> str:
    """The COLMAP commands that start a self-calibration from a seed and refine it."""
    return (
        "colmap feature_extractor --database_path database.db --image_path IMAGES "
        f"{_reader_options(seed)} && colmap exhaustive_matcher --database_path database.db && "
        "colmap mapper --database_path database.db --image_path IMAGES --output_path OUT "
        "--Mapper.ba_refine_focal_length 1 --Mapper.ba_refine_extra_params 1"
    )


def _reader_options(calibration: Calibration) -> str:
    model, parameters = colmap_camera(calibration)
    values = ",".join(repr(value) for value in parameters)
    return (
        f"--ImageReader.single_camera 1 --ImageReader.camera_model {model} "
        f'--ImageReader.camera_params "{values}"'
    )


def _colmap_script(cameras: Sequence[HandedOver]) -> str:
    lines = [
        "#!/bin/sh",
        "# usage: sh colmap.sh IMAGE_DIR DATABASE   (from the folder this script lies in)",
        "# One run of the extractor a camera: K of one camera is wrong for every other.",
        "set -eu",
    ]
    for camera in cameras:
        lines += ["", f"# {camera.calibration.camera} ({camera.calibration.grade})"]
        if camera.calibration.distortion is None:
            lines.append("# Its distortion is unknown: PINHOLE holds for undistorted images only.")
        lines.append(
            f'colmap feature_extractor --database_path "$2" --image_path "$1" '
            f"--image_list_path {shlex.quote(f'colmap.{camera.slug}.txt')} {_reader_options(camera.calibration)}"
        )
    lines += [
        "",
        "# A measured K is not a start: keep bundle adjustment from moving it with",
        "#   colmap mapper … --Mapper.ba_refine_focal_length 0 --Mapper.ba_refine_principal_point 0 \\",
        "#     --Mapper.ba_refine_extra_params 0",
    ]
    return "\n".join(lines) + "\n"


def _normalised(calibration: Calibration) -> dict[str, float]:
    """Focal lengths and principal point in units of the longer side, from the middle of the image."""
    K = calibration.intrinsics
    if K.skew:
        raise UnsupportedModelError(f"OpenSfM's models have no skew, this K has {K.skew:g} px")
    longer = float(max(K.image_size))
    cx, cy = file_from_canonical((K.cx, K.cy), Origin.IMAGE_CENTRE, K.image_size)
    return {"focal_x": K.fx / longer, "focal_y": K.fy / longer, "c_x": cx / longer, "c_y": cy / longer}


def _opensfm(calibration: Calibration) -> dict[str, object]:
    width, height = calibration.intrinsics.image_size
    d = calibration.distortion
    if isinstance(d, KannalaBrandt):
        kind, coefficients = "fisheye_opencv", d.coefficients
    elif d is None or isinstance(d, NoDistortion):
        kind, coefficients = "brown", BrownConrady(k1=0.0, k2=0.0, p1=0.0, p2=0.0).coefficients
    elif isinstance(d, BrownConrady):
        kind, coefficients = "brown", d.coefficients
    else:
        raise UnsupportedModelError(f"OpenSfM has no model that is exactly {d.model!r}")
    return {
        "projection_type": kind,
        "width": width,
        "height": height,
        **_normalised(calibration),
        **coefficients,
    }


def _odm(calibration: Calibration) -> dict[str, object]:
    model = _opensfm(calibration)
    focal = (float(str(model["focal_x"])) + float(str(model["focal_y"]))) / 2
    return {**model, "focal": focal}


def _opensfm_name(camera: HandedOver, projection: str) -> str:
    """OpenSfM's own name of a camera, "make model width height projection focal", without its "v2 ".

    Its last word is OpenSfM's *prior*, FocalLengthIn35mmFilm / 36 or FocalLength over the focal plane's width,
    else 0.85: an override under any other name is not found.
    """
    metadata = camera.metadata
    width, height = metadata.size
    make, model = metadata.make or "unknown", metadata.lens or metadata.model or "unknown"
    if isinstance(camera.calibration.distortion, KannalaBrandt):
        projection = "fisheye_opencv"
    words = [make.strip(), model.strip(), str(width), str(height), projection, str(_exif_prior(metadata))[:6]]
    return " ".join(words).lower()


def _exif_prior(metadata: ImageMetadata) -> float:
    if metadata.focal_35mm is not None:
        return float(metadata.focal_35mm) / 36.0
    per_mm = Scene(metadata=metadata).focal_plane_px_per_mm()
    if metadata.focal_mm is not None and per_mm is not None:
        return metadata.focal_mm * per_mm[0] / metadata.size[0]
    return 0.85


def _json(document: object) -> bytes:
    return (json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()
