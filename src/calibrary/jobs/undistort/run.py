"""Undistortion of images, with a new camera and its file for each image size."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

from msgspec import Struct, field

from calibrary import parsers
from calibrary.atomic import write_files
from calibrary.calib.picture_files import Kind, Picture, decode, encode, reframed
from calibrary.calib.undistort import Interpolation, Undistorter
from calibrary.calib.undistort_plan import Plan, plan
from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import NoDistortion
from calibrary.errors import CalibraryError, InputError, UnsupportedModelError
from calibrary.evidence.dji import is_dewarped
from calibrary.jobs.images.folders import places_of_copies, refuse_overwriting
from calibrary.parsers.discovery import format_named
from calibrary.parsers.files import read_regular_file
from calibrary.parsers.format import Fidelity, Format
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.writing import why_unwritten
from calibrary.progress import Progress, log, stage
from calibrary.records import Meta, Record, replace

Share: TypeAlias = Annotated[float, Meta(ge=0, le=1)]


class UndistortedCamera(Record):
    """Camera of the undistorted images that were made from images of one size.

    Attributes:
        file: name of the calibration file in the output folder.
        format: of that file.
        verdict: how exactly it represents the calibration.
        dropped: what the format cannot represent.
        image_size: of the original images; that of the undistorted images is in the calibration.
        calibration: of the undistorted images.
        kept: fraction of the original pixels that the undistorted images show.
        empty: fraction of the undistorted images without content.
        notes: remarks.
    """

    file: str
    format: str
    verdict: Fidelity
    dropped: tuple[str, ...]
    image_size: ImageSize
    calibration: Calibration
    kept: Share
    empty: Share
    notes: tuple[str, ...]


class UndistortedImage(Record):
    """One image.

    Attributes:
        file: file name.
        output: path relative to the output folder; None if the image was not undistorted.
        camera: ``file`` of its camera in ``cameras``.
        warnings: objections to undistorting it.
        error: why it was not undistorted; None if it was.
    """

    file: str
    output: str | None
    camera: str | None
    warnings: tuple[str, ...]
    error: str | None


class UndistortReport(Record, tag_field="schema", tag="calibrary/undistort-1"):
    """Output of ``calibrary undistort --json``: the new cameras, and all images.

    Attributes:
        calibration: name of the calibration file that was used.
        cameras: one for each image size.
        images: in the given order.
    """

    calibration: str
    cameras: tuple[UndistortedCamera, ...]
    images: tuple[UndistortedImage, ...]

    @property
    def is_good(self) -> bool:
        """Whether every image was undistorted."""
        return all(one.error is None for one in self.images)


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


class NewCamera(Struct, frozen=True, kw_only=True):
    """Camera of the undistorted images that were made from images of one size."""

    plan: Plan
    undistorter: Undistorter
    report: UndistortedCamera


class NewCameras(Struct, kw_only=True):
    """Makes the camera, and writes its file, for each image size that occurs; arguments as of the job."""

    calibration: Calibration
    source: Path
    out: Path
    to: str
    keep: str | float
    size: ImageSize | Literal["same-focal"] | None
    max_angle_deg: float
    interpolation: str
    mask: bool
    force: bool
    by_size: dict[ImageSize, NewCamera] = field(default_factory=dict)

    @property
    def record(self) -> Format:
        """The format of the cameras' files."""
        return format_named(self.to)

    @property
    def alpha(self) -> float | None:
        """OpenCV's alpha; None keeps K."""
        return ALPHAS.get(self.keep) if isinstance(self.keep, str) else self.keep

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
        return self.out / f"{stem}{suffix or self.record.suffixes[0]}"

    def rehearse(self) -> None:
        """Check before any image is read that a camera can be made for the calibration's own image size.

        Raises:
            InputError: its distortion is unknown, no K meets the request, or the format cannot represent it.
        """
        made, _ = self._chosen(self.calibration)
        try:
            parsers.encode([_pinhole(made)], self.record, name=self.path().name)
        except UnsupportedModelError as error:
            raise UnsupportedModelError(why_unwritten(error)) from None

    def _chosen(self, source: Calibration) -> tuple[Plan, str | None]:
        """The plan for images of one size, and a note on how much of them is kept."""
        made = self._planned(source)
        if self.alpha is not None or made.kept >= LEAST_KEPT:
            return made, None
        if self.keep != AUTO or made.kept >= TOO_LITTLE:
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
            "--keep same keeps K, --keep all every pixel, and --max-angle-deg says how far off the axis they look"
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
        return f"{proposed}; --max-angle-deg says how far off the axis they look"

    def _planned(self, source: Calibration, *, alpha: float | None = None) -> Plan:
        return plan(
            source,
            alpha=self.alpha if alpha is None else alpha,
            size=self.size if self.size != SAME_FOCAL else None,
            same_focal=self.size == SAME_FOCAL,
            max_angle_deg=self.max_angle_deg,
        )

    def _written(self, size: ImageSize) -> NewCamera:
        source, notes = self.calibration, []
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
        undistorter = Undistorter(made, interpolation=Interpolation(self.interpolation))
        calibration = _pinhole(made)
        path, mask = self.path(size), self.path(size, suffix=".mask.png")
        data, verdict = parsers.encode([calibration], self.record, name=path.name)
        files = {path: data}
        if self.mask:
            files[mask] = encode(Picture(pixels=undistorter.mask(), kind=Kind.PNG))
        self.refuse_the_calibration(path)
        _write(files, force=self.force)
        report = UndistortedCamera(
            file=path.name,
            format=self.record.name,
            verdict=verdict.outcome,
            dropped=tuple(verdict.dropped),
            image_size=size,
            calibration=calibration,
            kept=made.kept,
            empty=made.empty,
            notes=tuple(notes),
        )
        return NewCamera(plan=made, undistorter=undistorter, report=report)

    def refuse_the_calibration(self, path: Path) -> None:
        """Refuse to overwrite the calibration.

        Raises:
            InputError: ``path`` is its file.
        """
        if path.resolve() == self.source.resolve():
            raise InputError("it would overwrite the calibration; give another --out", source=str(path))


def undistort_all(
    images: Sequence[Path], cameras: NewCameras, *, kind: str | None, quality: int, progress: Progress | None
) -> UndistortReport:
    """Undistort images and write them with their new camera; an image that fails does not stop the others.

    Raises:
        InputError: as for :func:`calibrary.jobs.undistort.undistort`.
    """
    grade = cameras.calibration.grade
    if not grade.is_metric:
        raise InputError(
            f"its K is a {grade.value}, a guess; pictures undistorted with it would pass for a pinhole's. Wanted a "
            "calibration",
            source=cameras.source.name,
        )
    copies = [(image, _renamed(place, kind)) for image, place in places_of_copies(images, cameras.out)]
    cameras.refuse_the_calibration(cameras.path())
    refuse_overwriting(copies, done="undistort", force=cameras.force, also=[cameras.path()])
    cameras.rehearse()
    done: list[UndistortedImage] = []
    try:
        for image, output in copies:
            with stage(f"undistorted {image}"):
                done.append(_undistorted(image, output, cameras, kind=kind, quality=quality))
            if progress is not None:
                progress(len(done), len(copies), "images")
    except KeyboardInterrupt as error:
        error.args = (f"{len(done)} of {len(copies)} images were undistorted",)
        raise
    made = tuple(one.report for one in cameras.by_size.values())
    return UndistortReport(calibration=cameras.source.name, cameras=made, images=tuple(done))


def _renamed(path: Path, kind: str | None) -> Path:
    if kind is None or path.suffix.lower() in KINDS[kind]:
        return path
    return path.with_suffix(f".{kind}")


def _undistorted(
    image: Path, output: Path, cameras: NewCameras, *, kind: str | None, quality: int
) -> UndistortedImage:
    """Undistort and write one image; an error is stored in the result."""
    try:
        picture = decode(read_regular_file(image, max_bytes=MAX_PICTURE_BYTES), source=image.name)
        height, width = picture.pixels.shape[:2]
        camera = cameras.of((width, height))
        old, new = camera.plan.source.intrinsics, camera.plan.intrinsics
        keeps_focal = (old.fx, old.fy, old.image_size) == (new.fx, new.fy, new.image_size)
        result = reframed(picture, camera.undistorter(picture.pixels), keeps_focal=keeps_focal)
        result = replace(result, kind=Kind(kind) if kind else picture.kind)
        _write({output: encode(result, quality=quality)}, force=cameras.force)
    except CalibraryError as error:
        named = str(error) if image.name in str(error) else f"{image.name}: {error}"
        log.info("not undistorted: %s", named)
        return UndistortedImage(file=image.name, output=None, camera=None, warnings=(), error=named)
    return UndistortedImage(
        file=image.name,
        output=output.relative_to(cameras.out).as_posix(),
        camera=camera.report.file,
        warnings=tuple(_doubts(image)),
        error=None,
    )


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
