"""The work of ``calibrary undistort``: a camera for every size of image, its file, and one picture after another."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from calibrary.errors import CalibraryError, InputError

if TYPE_CHECKING:
    from calibrary.calib.undistort import Plan, Undistorter
    from calibrary.calibration import Calibration, ImageSize
    from calibrary.parsers.format import Format, WriteVerdict

__all__ = [
    "ALPHAS",
    "SAME_FOCAL",
    "Cameras",
    "Done",
    "Job",
    "Written",
    "refuse_the_calibration",
    "undistorted",
]

ALPHAS: Final[Mapping[str, float | None]] = {"same": None, "all": 1.0, "valid": 0.0}
SAME_FOCAL: Final = "same-focal"
MAX_PICTURE_BYTES = 4 * 1024**3


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One picture and where it goes."""

    image: Path
    output: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """One picture and what came of it."""

    job: Job
    size: ImageSize | None = None
    warnings: tuple[str, ...] = ()
    error: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """The camera of the new pictures that came from images of one size."""

    plan: Plan
    undistorter: Undistorter
    calibration: Calibration
    path: Path
    verdict: WriteVerdict
    notes: tuple[str, ...]


@dataclass(slots=True, kw_only=True)
class Cameras:
    """Makes a camera, and writes its file, for every size of image that comes along."""

    arguments: argparse.Namespace
    calibration: Calibration
    record: Format
    by_size: dict[ImageSize, Written] = field(default_factory=dict)

    def of(self, size: ImageSize) -> Written:
        """The camera of images of one size.

        Raises:
            InputError: they are no such camera's, or its file cannot be written.
        """
        if size not in self.by_size:
            self.by_size[size] = self._written(size)
        return self.by_size[size]

    def path(self, size: ImageSize | None = None, *, suffix: str | None = None) -> Path:
        """The first camera's file has a plain name; others, which are rare, carry the size of their images."""
        stem = "camera" if size is None or not self.by_size else "camera-{}x{}".format(*size)
        out: Path = self.arguments.out
        return out / f"{stem}{suffix or self.record.suffixes[0]}"

    def rehearse(self) -> None:
        """Find out, before any image is read, whether there can be a camera of the calibration's own size.

        Raises:
            InputError: its distortion is unknown, no K is as it was asked for, or the format does not hold it.
        """
        from calibrary import parsers

        made = self._planned(self.calibration)
        parsers.encode([_pinhole(made)], self.record, name=self.path().name)

    def _planned(self, source: Calibration) -> Plan:
        from calibrary.calib.undistort import plan

        given = self.arguments
        return plan(
            source,
            alpha=given.alpha if given.alpha is not None else ALPHAS[given.keep],
            size=given.size if given.size != SAME_FOCAL else None,
            same_focal=given.size == SAME_FOCAL,
            max_angle_deg=given.max_angle,
        )

    def _written(self, size: ImageSize) -> Written:
        from calibrary import parsers
        from calibrary.calib.picture_files import Kind, Picture, encode
        from calibrary.calib.undistort import Interpolation, Undistorter

        given, before = self.arguments, self.calibration.intrinsics.image_size
        source, notes = self.calibration, []
        if size != before:
            source = source.scaled(size)
            notes.append(
                f"the calibration is of {before[0]}×{before[1]} px; it was scaled to {size[0]}×{size[1]}"
            )
        made = self._planned(source)
        if made.cropped_to_deg is not None:
            notes.append(
                f"the lens sees more than a plane shows well; {made.cropped_to_deg:g}° of it are kept"
            )
        undistorter = Undistorter(made, interpolation=Interpolation(given.interpolation))
        calibration = _pinhole(made)
        path, mask = self.path(size), self.path(size, suffix=".mask.png")
        data, verdict = parsers.encode([calibration], self.record, name=path.name)
        files = {path: data}
        if given.mask:
            files[mask] = encode(Picture(pixels=undistorter.mask(), kind=Kind.PNG))
        refuse_the_calibration(path, given)
        _write(files, force=given.force)
        return Written(
            plan=made,
            undistorter=undistorter,
            calibration=calibration,
            path=path,
            verdict=verdict,
            notes=tuple(notes),
        )


def refuse_the_calibration(path: Path, arguments: argparse.Namespace) -> None:
    """Keep what is read from being replaced by what is written.

    Raises:
        InputError: ``path`` is the calibration's own.
    """
    if path.resolve() == arguments.calibration.resolve():
        raise InputError("it would overwrite the calibration; give another --out", source=str(path))


def undistorted(job: Job, cameras: Cameras) -> Done:
    """One picture, written; what is wrong with it stops no other."""
    from calibrary.calib.picture_files import Kind, decode, encode, reframed
    from calibrary.parsers.files import read_regular_file
    from calibrary.records import replace

    given = cameras.arguments
    try:
        picture = decode(read_regular_file(job.image, max_bytes=MAX_PICTURE_BYTES), source=job.image.name)
        height, width = picture.pixels.shape[:2]
        camera = cameras.of((width, height))
        old, new = camera.plan.source.intrinsics, camera.plan.intrinsics
        keeps_focal = (old.fx, old.fy, old.image_size) == (new.fx, new.fy, new.image_size)
        result = reframed(picture, camera.undistorter(picture.pixels), keeps_focal=keeps_focal)
        result = replace(result, kind=Kind(given.kind) if given.kind else picture.kind)
        _write({job.output: encode(result, quality=given.quality)}, force=given.force)
    except CalibraryError as error:
        named = str(error) if job.image.name in str(error) else f"{job.image.name}: {error}"
        return Done(job=job, error=named)
    return Done(job=job, size=(width, height), warnings=tuple(_doubts(job.image)))


def _doubts(image: Path) -> Iterator[str]:
    """What in an image's metadata speaks against undistorting it."""
    from calibrary.evidence.dji import is_dewarped
    from calibrary.parsers.imagery import read_metadata

    try:
        metadata = read_metadata(image)
    except InputError:
        return
    if is_dewarped(metadata):
        yield "the camera has undistorted this picture itself (DewarpFlag); a calibration of its raw ones does not fit"


def _write(files: Mapping[Path, bytes], *, force: bool) -> None:
    from calibrary.atomic import write_files

    for path in files:
        if path.exists() and not force:
            raise InputError("is there already; --force replaces it", source=str(path))
    write_files(files)


def _pinhole(made: Plan) -> Calibration:
    """The camera of the undistorted pictures."""
    from calibrary.distortion import NoDistortion
    from calibrary.records import replace

    source = made.source
    modes = [mode for mode in (source.camera.capture_mode, "undistorted") if mode]
    return replace(
        source,
        camera=replace(source.camera, image_size=made.intrinsics.image_size, capture_mode=", ".join(modes)),
        intrinsics=made.intrinsics,
        distortion=NoDistortion(),
        quality=None,
        provenance=replace(
            source.provenance, adaptation="undistorted", reference_size=source.intrinsics.image_size
        ),
        extras=(),
    )
