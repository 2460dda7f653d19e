"""Writing of a calibration into the metadata of JPEG and TIFF copies; the pixels are not changed.

Before it is written, each copy is read back with the readers for images. If they do not find the intended
calibration, no copy is written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Final, Literal

from calibrary.arguments import Place, Reading
from calibrary.atomic import check_folder, write_files
from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.catalogue import identified, load_catalogue
from calibrary.distortion import NoDistortion
from calibrary.errors import (
    AmbiguousCameraError,
    CalibraryError,
    InputError,
    MissingTagError,
    ParseError,
    UnknownCameraError,
    UnsupportedModelError,
)
from calibrary.evidence.context import Scene
from calibrary.evidence.frame import files_frame
from calibrary.jobs.files import Argument, read_argument
from calibrary.jobs.images.folders import places_of_copies, refuse_overwriting
from calibrary.jobs.layers import open_layers
from calibrary.jobs.resolve.run import resolved
from calibrary.jobs.stamp import TagSet, jpeg, tiff
from calibrary.jobs.stamp.tags import REMOVED, WORDS, Properties, Tags, camera_tags, dji_tags, merged
from calibrary.known_camera import match_key
from calibrary.parsers.files import read_regular_file
from calibrary.parsers.fit import compare
from calibrary.parsers.imagery.jpeg import SIGNATURE as JPEG
from calibrary.parsers.imagery.tiff import SIGNATURES as TIFF
from calibrary.parsers.images import decode_image, evidence_in, image_evidence
from calibrary.progress import Progress, log, stage
from calibrary.records import Meta, Record, replace
from calibrary.registry.places import registries
from calibrary.registry.resolution import FOCAL_TOLERANCE


class StampedImage(Record):
    """One image.

    Attributes:
        file: file name.
        outcome: "refused" if the calibration does not belong to its camera or the tags cannot represent it,
            "unreadable" if the image cannot be read or is not a file that can contain the tags.
        output: path of the copy relative to the output folder; None if there is none.
        calibration: name of the file, or KEY of the entry, with the calibration.
        tags: names of the written tags.
        max_error_px: largest error of the projection anywhere in the image, from reading back the copy; 0 if
            all numbers are equal to 1e-12.
        notes: remarks.
        reason: why it was not stamped; None if it was.
    """

    file: str
    outcome: Literal["stamped", "refused", "unreadable"]
    output: str | None = None
    calibration: str | None = None
    tags: tuple[str, ...] = ()
    max_error_px: Annotated[float, Meta(ge=0)] | None = None
    notes: tuple[str, ...] = ()
    reason: str | None = None


class StampReport(Record, tag_field="schema", tag="calibrary/stamp-1"):
    """Output of ``calibrary stamp --json``.

    Attributes:
        dry_run: whether nothing was written.
        tag_sets: the requested tag sets.
        images: in the given order.
    """

    dry_run: bool
    tag_sets: tuple[TagSet, ...]
    images: tuple[StampedImage, ...]

    @property
    def is_good(self) -> bool:
        """Whether every image was stamped."""
        return all(one.outcome == "stamped" for one in self.images)


MAX_IMAGE_BYTES: Final = 4 * 1024**3
UNIT_GRADES: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})
"""Grades that readers assign to these tags; a K of a lower grade would gain a higher one by stamping."""
READ_BACK_SLACK: Final = 1e-6
"""Tolerance in px for reading back, for rounding to decimals and conversion to mm."""


def one_camera(
    calibration: Calibration | str | Path, reading: Reading, registry: Place | Sequence[Place] | None
) -> Callable[[Path], Argument]:
    """The same calibration for every image.

    Raises:
        InputError, RegistryError: as for :func:`read_argument`.
    """
    if isinstance(calibration, Calibration):
        used = Argument(label=str(calibration.camera), calibration=calibration)
    else:
        used = read_argument(str(calibration), reading, registry)
    return lambda _: used


def by_registry(registry: Place | Sequence[Place] | None) -> Callable[[Path], Argument]:
    """The entry of the first registry that has one for the camera and the day of an image.

    Raises:
        RegistryError: there is no registry.
    """
    layers = open_layers(registries(registry, needed=True), catalogue=True)

    def of_image(image: Path) -> Argument:
        found = resolved(layers, image)
        if found.calibration is None:
            reasons = "; ".join(f"{one.path}: {one.reason}" for one in found.near[:1])
            raise UnknownCameraError(f"no entry for {found.camera}" + (f" ({reasons})" if reasons else ""))
        if found.entry is None:
            raise UnknownCameraError(f"no entry for {found.camera} but the catalogue's")
        return Argument(label=found.entry.id, calibration=found.calibration)

    return of_image


def stamp_all(
    images: Sequence[Path],
    camera: Callable[[Path], Argument],
    out: Path,
    *,
    tags: tuple[TagSet, ...],
    max_error_px: float,
    force: bool,
    dry_run: bool,
    progress: Progress | None,
) -> StampReport:
    """Write a calibration into copies of images; a refused image does not stop the others.

    Args:
        images: files, and folders with their sub-folders.
        camera: returns the calibration of the camera that took an image, and its label.
        out: folder for the copies.
        tags: the sets to write; those that cannot represent the calibration are omitted, at least one must.
        max_error_px: largest allowed error of a projection anywhere in the image.
        force: whether to replace existing files.
        dry_run: whether to do everything except write.
        progress: called with (images done, total, "images").

    Raises:
        InputError: there is no image, or a file would be overwritten; nothing is written.
    """
    copies = list(places_of_copies(images, out))
    refuse_overwriting(copies, done="stamp", force=force)
    if not dry_run:
        check_folder(out / "copy")
    done: list[StampedImage] = []
    try:
        for image, copy in copies:
            with stage(f"stamped {image}"):
                found, content = _stamp_one(image, camera, tags, max_error_px)
            if content is not None:
                found = replace(found, output=copy.relative_to(out).as_posix())
                if not dry_run:
                    write_files({copy: content})
            done.append(found)
            if progress is not None:
                progress(len(done), len(copies), "images")
    except KeyboardInterrupt as error:
        error.args = (f"{len(done)} of {len(copies)} images were looked at",)
        raise
    return StampReport(dry_run=dry_run, tag_sets=tags, images=tuple(done))


def _stamp_one(
    image: Path, camera: Callable[[Path], Argument], tags: tuple[TagSet, ...], max_error_px: float
) -> tuple[StampedImage, bytes | None]:
    """The result for an image, which may be an error, and the bytes of its copy."""
    try:
        data = read_regular_file(image, max_bytes=MAX_IMAGE_BYTES)
        scene = image_evidence(image).scene
    except InputError as error:
        return _without_copy(image, "unreadable", error)
    try:
        if not data.startswith((JPEG, *TIFF)):
            raise ParseError("expected a JPEG or a TIFF: the tags of other files are not changed")
        return _stamped(data, scene, image.name, camera(image), tags, max_error_px)
    except ParseError as error:
        return _without_copy(image, "unreadable", error)
    except (InputError, UnknownCameraError, AmbiguousCameraError) as error:
        return _without_copy(image, "refused", error)


def _without_copy(
    image: Path, outcome: Literal["refused", "unreadable"], error: CalibraryError
) -> tuple[StampedImage, None]:
    log.info("not stamped: %s: %s", image, error)
    reason = error.message if isinstance(error, InputError) else str(error)
    return StampedImage(file=image.name, outcome=outcome, reason=reason), None


def _stamped(
    data: bytes, scene: Scene, name: str, used: Argument, tags: tuple[TagSet, ...], max_error_px: float
) -> tuple[StampedImage, bytes]:
    """The result for an image, and the bytes of its copy.

    Raises:
        ParseError: the file cannot contain the tags.
        InputError: the calibration does not belong to the image, or the tags cannot represent it.
    """
    calibration = used.calibration
    if (reason := _against(calibration, scene)) is not None:
        raise InputError(reason)
    # Tags refer to the image size in EXIF, which readers then convert to the file's.
    framed = calibration.scaled(files_frame(scene.metadata))
    made, notes = _tags(replace(framed, quality=None), scene.px_per_mm(), tags, max_error_px)
    if not made:
        raise UnsupportedModelError("; ".join(notes))
    properties = {key: text for one in made for key, text in one.properties.items()}
    content = _changed(data, properties, name)
    error_px = _read_back(content, name, calibration, max_error_px)
    if calibration.grade is not Grade.CALIBRATED:
        notes += (f"the K is {calibration.grade.value}; readers take these tags for calibrated",)
    if calibration.camera.model is None:
        notes += ("the calibration names no camera: only its image size was compared",)
    found = StampedImage(
        file=name,
        outcome="stamped",
        calibration=used.label,
        tags=tuple(f"{prefix}:{local}" for prefix, _, local in properties),
        max_error_px=error_px,
        notes=notes,
    )
    return found, content


# Cached, because a fit takes a second and most images of a run have the same camera.
@lru_cache(maxsize=64)
def _tags(
    calibration: Calibration,
    px_per_mm: tuple[float, float] | None,
    tag_sets: tuple[TagSet, ...],
    max_error_px: float,
) -> tuple[tuple[Tags, ...], tuple[str, ...]]:
    """The tag sets that represent a calibration, and the reasons why others do not."""
    made, notes = [], []
    for name in tag_sets:
        try:
            if name == "dji":
                made.append(dji_tags(calibration, max_error_px=max_error_px))
            else:
                made.append(camera_tags(calibration, px_per_mm, max_error_px=max_error_px))
        except UnsupportedModelError as error:
            notes.append(f"no {name} tags: {error.message}")
    return tuple(made), tuple(notes)


def _changed(data: bytes, properties: Properties, source: str) -> bytes:
    """The bytes of the image with the tags replaced."""

    def merge(packet: bytes | None) -> bytes:
        return merged(packet, REMOVED, properties, source=source)

    if data.startswith(JPEG):
        return jpeg.with_xmp(data, merge, WORDS, source)
    return tiff.with_xmp(data, merge, source)


def _read_back(content: bytes, source: str, calibration: Calibration, limit: float) -> float:
    """Difference in px between the calibration read back from a copy and the intended one.

    Raises:
        InputError: the difference exceeds the limit.
    """
    try:
        [found] = decode_image(content, source)
    except MissingTagError:
        # Its message gives advice for the original image, not for the copy.
        dropped = evidence_in(content, source).dropped
        reasons = "; ".join(f"{one.tag}: {one.reason}" for one in dropped) or "they give no K"
        raise InputError(f"readers would not believe the tags: {reasons}") from None
    fit = compare(calibration, found)
    if fit.exact:
        return 0.0
    if not fit.max_px <= limit + READ_BACK_SLACK:
        raise InputError(
            f"a reader of the copy would take fx {found.intrinsics.fx:.2f} px from {found.provenance.tag}, up to "
            f"{fit.max_px:.3g} px off the calibration"
        )
    return fit.max_px


def _against(calibration: Calibration, scene: Scene) -> str | None:
    """Reason why a calibration must not be written into an image, or None."""
    grade, size, metadata = calibration.grade, calibration.intrinsics.image_size, scene.metadata
    if grade not in UNIT_GRADES:
        return f"its K is {grade.value}, and readers take these tags for a calibrated one"
    if metadata.size != size:
        return "the image is {}×{} px, the calibration of {}×{} px".format(*metadata.size, *size)
    key = identified(metadata, load_catalogue()).key
    differing = next(_differences(calibration.camera, key), None)
    if differing is not None:
        return differing
    dewarped = key.capture_mode is not None and "dewarped" in key.capture_mode
    if dewarped and calibration.distortion not in {None, NoDistortion()}:
        return "the camera has undistorted it already (DewarpFlag), and the calibration is of its raw images"
    return None


def _differences(stated: CameraKey, seen: CameraKey) -> Iterator[str]:
    """Yield the differences between the camera of a calibration and that of an image, as far as both are known."""
    for name, words in (("make", "make"), ("model", "model"), ("sub_camera", "sub-camera"), ("lens", "lens")):
        one, other = getattr(stated, name), getattr(seen, name)
        if one and other and match_key(one) != match_key(other):
            yield f"another camera: its {words} is {other}, the calibration's {one}"
    if stated.serial and seen.serial and stated.serial != seen.serial:
        yield "another unit: its serial number is not the calibration's"
    one_mm, other_mm = stated.focal_mm, seen.focal_mm
    if one_mm and other_mm and abs(other_mm / one_mm - 1) > FOCAL_TOLERANCE:
        yield f"taken at {other_mm:g} mm, the calibration is of {one_mm:g} mm"
