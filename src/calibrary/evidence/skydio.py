"""Skydio's XMP, https://www.skydio.com/drone-skydio/1.0/.

``CalibratedFocalLength`` and ``CalibratedOpticalCenter`` are structures of X and Y in px of the *full* sensor, even
if the file is a crop. The origin is the centre of the first pixel: prototype values of the centre are (W-1)/2.
Thermal images contain the colour camera's values.
"""

from __future__ import annotations

from collections.abc import Iterator

from calibrary.calibration import Grade, ImageSize, Intrinsics, Origin, canonical_from_file
from calibrary.errors import InputError
from calibrary.evidence.context import Dropped, Finding, Scene, Source, numbers

SCHEMA = "drone-skydio"
TAG = "drone-skydio:CalibratedFocalLength"

CENTRE_SLACK = 0.06
"""Largest distance of a real principal point from the image centre, as a fraction of the side (2.5 % is the largest
observed)."""


def estimates(scene: Scene) -> Iterator[Finding]:
    """The calibrated focal length with its optical centre."""
    focal = _pair(scene, "CalibratedFocalLength")
    centre = _pair(scene, "CalibratedOpticalCenter")
    if focal is None:
        return
    if min(focal) <= 0:
        yield Dropped(
            source=Source.SKYDIO_CALIBRATED, tag=TAG, reason="does not contain two positive numbers of pixels"
        )
        return
    reason = "the full sensor size of this camera is unknown; register the camera with its native size"
    for size in _full_frames(scene, centre):
        try:
            cx, cy = (
                canonical_from_file(centre, Origin.PIXEL_CENTRE, size)
                if centre is not None
                else (size[0] / 2, size[1] / 2)
            )
            intrinsics = Intrinsics(fx=focal[0], fy=focal[1], cx=cx, cy=cy, image_size=size)
        except InputError as error:
            reason = error.message
            continue
        foreign = scene.is_foreign(intrinsics)
        if foreign is None:
            yield scene.estimate(
                Source.SKYDIO_CALIBRATED,
                TAG,
                Grade.CALIBRATED,
                intrinsics,
                measured_centre=centre is not None,
            )
            return
        reason = foreign
    yield Dropped(source=Source.SKYDIO_CALIBRATED, tag=TAG, reason=reason)


def _pair(scene: Scene, name: str) -> tuple[float, float] | None:
    x = numbers(scene.metadata.xmp_text(SCHEMA, f"{name}/X") or "")
    y = numbers(scene.metadata.xmp_text(SCHEMA, f"{name}/Y") or "")
    return (x[0], y[0]) if x and y and len(x) == len(y) == 1 else None


def _full_frames(scene: Scene, centre: tuple[float, float] | None) -> Iterator[ImageSize]:
    """Image sizes that the optical centre can refer to: those with a centre near it."""
    for size in (scene.native_size, *scene.frames()):
        if size is None:
            continue
        if centre is None:
            if size == scene.native_size:
                yield size
        elif all(abs(c / side - 0.5) <= CENTRE_SLACK for c, side in zip(centre, size, strict=True)):
            yield size
        elif size == scene.native_size:
            # The camera's own full frame does not fit: the tag is of another camera; is_foreign gives the
            # reason.
            yield size
