"""Limits of what states a K: how far a claim may be off, what confirms, and which names are of another camera.

Two thresholds are kept apart: a claim contradicts a K beyond the tolerances of both, and it confirms a K only within
:data:`CONFIRMS`: a wide tolerance must not make a witness. The tolerances are measured ones: on 3 565 models two public
lists of sensor widths differ by 0.5 % at the 95th percentile; focal plane and list by 0.9 % at the median; published
calibrations differ from nominal focal lengths by up to 3.3 %.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

from calibrary.calibration import Calibration, CameraKey
from calibrary.evidence.context import Source as TagSource
from calibrary.evidence.context import SourceEstimate
from calibrary.evidence.optics import DIAGONAL_35MM
from calibrary.evidence.weighing import Evidence
from calibrary.known_camera import SUB_CAMERAS, normalise_sub_camera
from calibrary.policy import Policy
from calibrary.registry.entry import USUAL_TOLERANCE

CONFIRMS: Final = 0.03
"""Largest relative difference of two focal lengths that confirm each other, before the rounding of a tag."""
CONFIRMS_AT_MOST: Final = 0.05
NOMINAL: Final = 0.05
"""Least relative difference at which a nominal focal length contradicts a measured one: lenses are not as engraved."""
SQUARE: Final = 0.02
"""Largest difference of fx and fy of a sensor size that is the camera's: pixels are square."""
EXIF: Final = "EXIF"
"""Voice of the tags that rest on EXIF's focal lengths."""
OTHER_FOCAL: Final = 0.05
"""Relative difference of two focal lengths in millimetres that are of two lenses, or two settings of a zoom."""

OF_KNOWN: Final = frozenset({TagSource.CATALOGUE_PITCH, TagSource.CATALOGUE_DESIGN})
"""What is known of a camera by its name, which includes how its lens differs from the engraved focal length."""

TOLERANCES: Final = {
    TagSource.GIVEN_SENSOR: 0.02,  # a data sheet's sensor size
    TagSource.STATED: 0.03,  # a camera or a focal length that a person states
    TagSource.FOCAL_PLANE: 0.02,  # a resolution of the focal plane
    TagSource.CATALOGUE_PITCH: 0.03,  # the catalogue's pixel pitch
    TagSource.CATALOGUE_DESIGN: 0.03,  # the catalogue's focal length
    TagSource.DJI_DESIGN: 0.03,  # the maker's design value
    TagSource.FIELD_OF_VIEW: 0.03,  # a stated field of view
    TagSource.LISTED_SENSOR: 0.02,  # a list's sensor width
    TagSource.FULL_FRAME: 0.02,  # a 36 mm sensor
    TagSource.FOCAL_35MM: 0.02,  # whole millimetres of a 35 mm equivalent
}
"""How far the focal length of a nominal claim may be off, as a fraction."""


def known_to_be_off(source: TagSource, evidence: Evidence) -> float:
    """How far what a camera writes is from its fitted focal length, where the catalogue states both."""
    known, written = evidence.scene.known, evidence.scene.metadata
    fitted = known.fx_over_w_at(known.focal_mm) if known is not None and known.zoom_mm is None else None
    if known is None or known.native_size is None or fitted is None:
        return 0.0
    width, nominal = known.native_size[0], None
    if source is TagSource.CATALOGUE_PITCH and known.focal_mm and known.pitch_um and written.focal_mm:
        if abs(written.focal_mm / known.focal_mm - 1.0) <= OTHER_FOCAL:
            nominal = written.focal_mm * 1000.0 / known.pitch_um / width
    elif source is TagSource.FOCAL_35MM and known.focal_35mm and known.focal_35mm == written.focal_35mm:
        nominal = known.focal_35mm / DIAGONAL_35MM * math.hypot(*known.native_size) / width
    return abs(fitted / nominal - 1.0) if nominal is not None else 0.0


def known_tolerance(policy: Policy) -> float:
    """How far a K of a known camera may be from what is known of it, as a fraction."""
    return policy.known_camera_tolerance if policy.known_camera_tolerance is not None else USUAL_TOLERANCE


def engraved(one: SourceEstimate) -> float:
    """Relative difference of a nominal focal length from a measured one that is usual, because it is as engraved."""
    return 0.0 if one.source in OF_KNOWN or one.grade.is_measured else NOMINAL


def foreign(calibration: Calibration, camera: CameraKey) -> str | None:
    """Which name of a calibration's camera is not that of the images, in words; None if none contradicts."""
    stated, model = calibration.camera, model_of(calibration)
    if model and camera.model and not _alike(model, camera.model):
        return f"it is of {model}, and these images are of {camera.model}"
    for what, one, other in (
        ("the unit", stated.serial, camera.serial),
        ("the camera", _part(stated.sub_camera), camera.sub_camera),
    ):
        if one and other and one != other:
            return f"it is of {what} {one[:8]}, and these images are of {other[:8]}"
    if stated.focal_mm and camera.focal_mm and abs(stated.focal_mm / camera.focal_mm - 1.0) > OTHER_FOCAL:
        return f"it is of a lens at {stated.focal_mm:g} mm, and these images are of {camera.focal_mm:g} mm"
    return None


def _part(name: str | None) -> str | None:
    """The sub-camera or band that a name states; None for what a file calls its cameras itself, as cam0 or by model."""
    word = normalise_sub_camera(name) if name else None
    return word if word and any(f"{word}-".startswith(f"{one}-") for one in SUB_CAMERAS) else None


def model_of(calibration: Calibration) -> str | None:
    """The camera model that a calibration states, in its key or as part of OpenSfM's name of a camera; None if none."""
    # Maker and model, then width, height, projection and focal length.
    named = dict(calibration.extras).get("opensfm/camera", "").split()[:-4]
    is_named = named and named[-1] != "unknown"
    return calibration.camera.model or (" ".join(named) if is_named else None)


def _alike(one: str, other: str) -> bool:
    """Whether two names may be of one model: words of one, run together, are the other, as GR II of Ricoh GR II."""
    a, b = (re.findall(r"\w+", name.casefold().replace("_", " ")) for name in (one, other))
    return _holds(a, "".join(b)) or _holds(b, "".join(a))


def _holds(words: Sequence[str], name: str) -> bool:
    ends = range(len(words))
    return any("".join(words[first : last + 1]) == name for first in ends for last in ends[first:])
