"""Undistortion of images, with a new camera and its file for each image size."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, Literal, TypeAlias

from msgspec import Struct, field

from calibrary import parsers
from calibrary.atomic import write_files
from calibrary.calib.picture_files import Kind, Picture, decode, encode, reframed
from calibrary.calib.undistort import Interpolation, Undistorter
from calibrary.calib.undistort_plan import Plan, plan
from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import NoDistortion
from calibrary.errors import CalibraryError, InputError
from calibrary.evidence.dji import is_dewarped
from calibrary.jobs.images.copies import places_of_copies, refuse_overwriting
from calibrary.jobs.undistort.report import UndistortedCamera, UndistortedImage, UndistortReport
from calibrary.parsers.discovery import format_named
from calibrary.parsers.files import read_regular_file
from calibrary.parsers.format import Format, WriteVerdict
from calibrary.parsers.imagery import read_metadata
from calibrary.progress import Progress, log, stage
from calibrary.records import replace

__all__ = [
    "ALPHAS",
    "AUTO",
    "SAME_FOCAL",
    "NewCamera",
    "UndistortRequest",
    "Undistorted",
    "Undistortion",
    "undistort",
]

SAME_FOCAL: Final = "same-focal"
ALPHAS: Final[Mapping[str, float | None]] = {"same": None, "all": 1.0, "valid": 0.0}
"""OpenCV's alpha by the extent of the image that is kept; None keeps K."""

AUTO: Final = "auto"
"""K is kept if it keeps enough of the image; otherwise a wide lens gets the extent with the best balance of kept and
empty pixels."""
LEAST_KEPT: Final = 0.8
"""If a smaller fraction is kept, another extent is proposed; a perspective lens with its own K keeps over 90 %."""
TOO_LITTLE: Final = 2 / 3
"""If a smaller fraction is kept, another extent is used; only fisheyes lose so much."""
TRIED: Final = (0.0, 0.25, 0.5, 0.75, 1.0)

MAX_PICTURE_BYTES: Final = 4 * 1024**3
KINDS: Final = {"jpg": {".jpg", ".jpeg", ".jpe"}, "tif": {".tif", ".tiff"}, "png": {".png"}}
Size: TypeAlias = ImageSize | Literal["same-focal"] | None


class UndistortRequest(Struct, frozen=True, kw_only=True):
    """Arguments of an undistortion.

    Attributes:
        images: files, and folders with their sub-folders.
        calibration: of the camera that took them.
        source: file that the calibration was read from.
        out: folder for the undistorted images and their camera.
        alpha: as in OpenCV: 0 for no empty pixels, 1 for no lost pixels; None keeps K.
        widens: whether to use another extent if K would keep too little of a wide lens's image.
        size: of the output in px; "same-focal" for the size that keeps the focal length in px; None for the
            image's.
        max_angle_deg: largest angle from the axis to show, for wide lenses.
        interpolation: "nearest", "linear", "cubic" or "lanczos".
        kind: "jpg", "png" or "tif"; None for the image's own.
        quality: of JPEGs, 1 … 100.
        mask: whether to write a mask of the pixels that are not empty.
        format: of the new camera's file.
        force: whether to replace existing files.
    """

    images: Sequence[Path]
    calibration: Calibration
    source: Path
    out: Path
    alpha: float | None = None
    widens: bool = False
    size: Size = None
    max_angle_deg: float = 80.0
    interpolation: str = "cubic"
    kind: str | None = None
    quality: int = 95
    mask: bool = False
    format: str = "opencv_storage"
    force: bool = False


class Undistorted(Struct, frozen=True, kw_only=True):
    """Result for one image.

    Attributes:
        image: original file.
        output: undistorted file.
        size: of the image in px; None if it was not undistorted.
        warnings: objections to undistorting it.
        error: why it was not undistorted.
    """

    image: Path
    output: Path
    size: ImageSize | None = None
    warnings: tuple[str, ...] = ()
    error: str | None = None


class NewCamera(Struct, frozen=True, kw_only=True):
    """Camera of the undistorted images that were made from images of one size."""

    plan: Plan
    undistorter: Undistorter
    calibration: Calibration
    path: Path
    verdict: WriteVerdict
    notes: tuple[str, ...]


class Undistortion(Struct, frozen=True, kw_only=True):
    """Result of an undistortion.

    Attributes:
        request: the arguments.
        images: in the given order.
        cameras: by size of the original images.
    """

    request: UndistortRequest
    images: tuple[Undistorted, ...]
    cameras: Mapping[ImageSize, NewCamera]

    @property
    def is_good(self) -> bool:
        """Whether every image was undistorted."""
        return all(one.error is None for one in self.images)

    def report(self) -> UndistortReport:
        """The result as a record for the JSON report."""
        return UndistortReport(
            calibration=self.request.source.name,
            cameras=tuple(
                UndistortedCamera(
                    file=camera.path.name,
                    format=self.request.format,
                    verdict=camera.verdict.outcome,
                    dropped=tuple(camera.verdict.dropped),
                    image_size=size,
                    calibration=camera.calibration,
                    kept=camera.plan.kept,
                    empty=camera.plan.empty,
                    notes=camera.notes,
                )
                for size, camera in self.cameras.items()
            ),
            images=tuple(
                UndistortedImage(
                    file=one.image.name,
                    output=one.output.relative_to(self.request.out).as_posix() if one.error is None else None,
                    camera=self.cameras[one.size].path.name if one.size is not None else None,
                    warnings=one.warnings,
                    error=one.error,
                )
                for one in self.images
            ),
        )


def undistort(request: UndistortRequest, progress: Progress | None = None) -> Undistortion:
    """Undistort images and write them with their new camera; an image that fails does not stop the others.

    Args:
        request: the arguments.
        progress: called with (images done, total, "images").

    Raises:
        InputError: the calibration was not measured or has an unknown distortion, no K meets the request,
            there is no image, or a file would be overwritten; nothing is written.
    """
    if not request.calibration.grade.is_metric:
        raise InputError(
            f"its K is a {request.calibration.grade.value}, a guess; pictures undistorted with it would pass for a "
            "pinhole's. Wanted a calibration",
            source=request.source.name,
        )
    cameras = _Cameras(request=request, record=format_named(request.format))
    images = list(_outputs(request))
    _refuse_the_calibration(cameras.path(), request)
    copies = [(one.image, one.output) for one in images]
    refuse_overwriting(copies, done="undistort", force=request.force, also=[cameras.path()])
    cameras.rehearse()
    done: list[Undistorted] = []
    try:
        for one in images:
            with stage(f"undistorted {one.image}"):
                done.append(_undistorted(one, cameras))
            if progress is not None:
                progress(len(done), len(images), "images")
    except KeyboardInterrupt as error:
        error.args = (f"{len(done)} of {len(images)} images were undistorted",)
        raise
    return Undistortion(request=request, images=tuple(done), cameras=cameras.by_size)


class _Cameras(Struct, kw_only=True):
    """Makes the camera, and writes its file, for each image size that occurs."""

    request: UndistortRequest
    record: Format
    by_size: dict[ImageSize, NewCamera] = field(default_factory=dict)

    def of(self, size: ImageSize) -> NewCamera:
        """The camera for images of one size.

        Raises:
            InputError: the calibration does not fit them, or its file cannot be written.
        """
        if size not in self.by_size:
            self.by_size[size] = self._written(size)
        return self.by_size[size]

    def path(self, size: ImageSize | None = None, *, suffix: str | None = None) -> Path:
        """Path of a camera's file; the name contains the image size except for the first camera."""
        stem = "camera" if size is None or not self.by_size else "camera-{}x{}".format(*size)
        return self.request.out / f"{stem}{suffix or self.record.suffixes[0]}"

    def rehearse(self) -> None:
        """Check before any image is read that a camera can be made for the calibration's own image size.

        Raises:
            InputError: its distortion is unknown, no K meets the request, or the format cannot represent it.
        """
        made, _ = self._chosen(self.request.calibration)
        parsers.encode([_pinhole(made)], self.record, name=self.path().name)

    def _chosen(self, source: Calibration) -> tuple[Plan, str | None]:
        """The plan for images of one size, and a note on how much of them is kept."""
        made = self._planned(source)
        if self.request.alpha is not None or made.kept >= LEAST_KEPT:
            return made, None
        if not self.request.widens or made.kept >= TOO_LITTLE:
            return made, self._proposal(made)
        plans = [made]
        for alpha in TRIED:
            try:
                plans.append(self._planned(source, alpha=alpha))
            except CalibraryError:
                continue
        # A wider view pays off as long as it keeps more additional pixels than it leaves empty.
        best = max(plans, key=lambda one: one.kept - one.empty)
        if best is made:
            return made, self._proposal(made)
        return best, (
            f"with its own K (fx {made.intrinsics.fx:.1f}) only {made.kept:.1%} of the images' pixels would be "
            f"kept, so the view was widened to fx {best.intrinsics.fx:.1f}, which keeps {best.kept:.1%}; "
            "--keep same keeps K, --keep all every pixel, and --max-angle says how far off the axis they look"
        )

    def _proposal(self, made: Plan) -> str:
        """Sentence on the loss with the camera's own K, and on what the other extents would keep."""
        others = []
        for name in ("all", "valid"):
            try:
                other = self._planned(made.source, alpha=ALPHAS[name])
            except CalibraryError:
                continue
            others.append(
                f"--keep {name} keeps {other.kept:.1%} of them, with {other.empty:.1%} of the new ones empty"
            )
        proposed = "; ".join(
            [f"K stays as it is, so only {made.kept:.1%} of the images' pixels are kept", *others]
        )
        return f"{proposed}; --max-angle says how far off the axis they look"

    def _planned(self, source: Calibration, *, alpha: float | None = None) -> Plan:
        given = self.request
        return plan(
            source,
            alpha=given.alpha if alpha is None else alpha,
            size=given.size if given.size != SAME_FOCAL else None,
            same_focal=given.size == SAME_FOCAL,
            max_angle_deg=given.max_angle_deg,
        )

    def _written(self, size: ImageSize) -> NewCamera:
        given, source, notes = self.request, self.request.calibration, []
        before = source.intrinsics.image_size
        if size != before:
            source = source.scaled(size)
            notes.append(
                f"the calibration is of {before[0]}×{before[1]} px; it was scaled to {size[0]}×{size[1]}"
            )
        made, extent = self._chosen(source)
        if made.cropped_to_deg is not None:
            notes.append(
                f"the lens sees more than a plane shows well; {made.cropped_to_deg:g}° of it are kept"
            )
        if extent is not None:
            notes.append(extent)
        undistorter = Undistorter(made, interpolation=Interpolation(given.interpolation))
        calibration = _pinhole(made)
        path, mask = self.path(size), self.path(size, suffix=".mask.png")
        data, verdict = parsers.encode([calibration], self.record, name=path.name)
        files = {path: data}
        if given.mask:
            files[mask] = encode(Picture(pixels=undistorter.mask(), kind=Kind.PNG))
        _refuse_the_calibration(path, given)
        _write(files, force=given.force)
        return NewCamera(
            plan=made,
            undistorter=undistorter,
            calibration=calibration,
            path=path,
            verdict=verdict,
            notes=tuple(notes),
        )


def _outputs(request: UndistortRequest) -> Iterator[Undistorted]:
    for image, place in places_of_copies(request.images, request.out):
        yield Undistorted(image=image, output=_renamed(place, request.kind))


def _renamed(path: Path, kind: str | None) -> Path:
    if kind is None or path.suffix.lower() in KINDS[kind]:
        return path
    return path.with_suffix(f".{kind}")


def _refuse_the_calibration(path: Path, request: UndistortRequest) -> None:
    if path.resolve() == request.source.resolve():
        raise InputError("it would overwrite the calibration; give another --out", source=str(path))


def _undistorted(one: Undistorted, cameras: _Cameras) -> Undistorted:
    """Undistort and write one image; an error is stored in the result."""
    given, image = cameras.request, one.image
    try:
        picture = decode(read_regular_file(image, max_bytes=MAX_PICTURE_BYTES), source=image.name)
        height, width = picture.pixels.shape[:2]
        camera = cameras.of((width, height))
        old, new = camera.plan.source.intrinsics, camera.plan.intrinsics
        keeps_focal = (old.fx, old.fy, old.image_size) == (new.fx, new.fy, new.image_size)
        result = reframed(picture, camera.undistorter(picture.pixels), keeps_focal=keeps_focal)
        result = replace(result, kind=Kind(given.kind) if given.kind else picture.kind)
        _write({one.output: encode(result, quality=given.quality)}, force=given.force)
    except CalibraryError as error:
        named = str(error) if image.name in str(error) else f"{image.name}: {error}"
        log.info("not undistorted: %s", named)
        return replace(one, error=named)
    return replace(one, size=(width, height), warnings=tuple(_doubts(image)))


def _doubts(image: Path) -> Iterator[str]:
    """Yield objections to undistorting an image, from its metadata."""
    try:
        metadata = read_metadata(image)
    except InputError:
        return
    if is_dewarped(metadata):
        yield "the camera has undistorted this picture itself (DewarpFlag); a calibration of its raw ones does not fit"


def _write(files: Mapping[Path, bytes], *, force: bool) -> None:
    for path in files:
        if path.exists() and not force:
            raise InputError("is there already; --force replaces it", source=str(path))
    write_files(files)


def _pinhole(made: Plan) -> Calibration:
    """The camera of the undistorted images."""
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
