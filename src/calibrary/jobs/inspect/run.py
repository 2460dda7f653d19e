"""Inspection of files: format, how it was recognised, and content."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from calibrary import parsers
from calibrary.admission import admission, why_implausible
from calibrary.arguments import Reading
from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import CalibraryError, FrameError, MissingSizeError
from calibrary.evidence.weighing import Evidence
from calibrary.jobs.files import read_file, read_unsized
from calibrary.jobs.images.folders import files_in
from calibrary.parsers.discovery import format_named
from calibrary.parsers.unsized import UnsizedCalibration
from calibrary.policy import FLEET
from calibrary.progress import Progress
from calibrary.records import Json, Record, replace


class InspectedTag(Record):
    """One EXIF tag.

    Attributes:
        name: directory and name, such as "EXIF FocalLength".
        value: as text, at most 80 characters.
    """

    name: str
    value: str


class InspectedFile(Record):
    """One file and its content.

    Attributes:
        file: file name without folder.
        folder: its folder, as far as it was given; empty for the current one.
        format: name of the format; None if it was not recognised.
        title: of the format.
        why: content by which the format was recognised.
        conventions: conventions of its numbers, in sentences.
        calibrations: calibrations in the file.
        unsized: calibrations without an image size; written among the calibrations.
        implausible: reason for each K that is not, or hardly, a camera's.
        warnings: on the calibrations.
        error: reason why the file was not read; None if it was.
        tags: EXIF tags of an image; None if they were not requested.
        tags_left_out: number of tags left out: positions, serial numbers, people's names, thumbnails and other
            binary values, tags without a known name.
    """

    file: str
    format: str | None = None
    why: str | None = None
    conventions: tuple[str, ...] = ()
    calibrations: tuple[Calibration, ...] = ()
    unsized: tuple[UnsizedCalibration, ...] = ()
    implausible: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    error: str | None = None
    folder: str = ""
    title: str | None = None
    tags: tuple[InspectedTag, ...] | None = None
    tags_left_out: Annotated[int, Meta(ge=0)] = 0

    @property
    def path(self) -> Path:
        """The file as it was given, or found in a folder that was."""
        return Path(self.folder, self.file)

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """Write all calibrations in one list; a missing image size is null."""
        whole, unsized = document["calibrations"], document.pop("unsized")
        if isinstance(whole, list) and isinstance(unsized, list):
            document["calibrations"] = whole + unsized
        return document

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        found = document.get("calibrations")
        if isinstance(found, list):
            document["calibrations"] = [item for item in found if not _is_unsized(item)]
            document["unsized"] = [item for item in found if _is_unsized(item)]
        return document

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        members = dict(schema["properties"])
        unsized = members.pop("unsized")
        whole = members["calibrations"]
        members["calibrations"] = whole | {"items": {"anyOf": [whole["items"], unsized["items"]]}}
        required = [name for name in schema["required"] if name != "unsized"]
        return schema | {"properties": members, "required": required}


def _is_unsized(item: Json) -> bool:
    K = item.get("intrinsics") if isinstance(item, dict) else None
    return isinstance(K, dict) and K.get("image_size") is None


class InspectReport(InspectedFile, tag_field="schema", tag="calibrary/inspect-1"):
    """Output of ``calibrary inspect FILE --json``."""


class InspectFilesReport(Record, tag_field="schema", tag="calibrary/inspect-files-1"):
    """Output of ``calibrary inspect --json`` for a folder or several files.

    Attributes:
        files: in reading order.
    """

    files: tuple[InspectedFile, ...]

    @property
    def is_read(self) -> bool:
        """Whether every file was read."""
        return all(one.error is None for one in self.files)

    @property
    def is_plausible(self) -> bool:
        """Whether every K is likely a camera's."""
        return not any(one.implausible for one in self.files)


def inspect_files(
    given: Sequence[Path], reading: Reading, *, tags: bool, progress: Progress | None
) -> InspectFilesReport:
    """Inspect files, and all files in folders and their sub-folders, in order; arguments as of the job."""
    paths: list[Path] = []
    for one in given:
        within = files_in(one) if one.is_dir() else [one]
        paths += [path for path in within if not tags or path == one or parsers.is_image_file(path)]
    read = _tags_of if tags else partial(_read, reading=reading)
    return InspectFilesReport(files=tuple(_inspected(paths, read, progress)))


def _inspected(
    paths: Sequence[Path], read: Callable[[Path], InspectedFile], progress: Progress | None
) -> Iterator[InspectedFile]:
    for done, path in enumerate(paths, start=1):
        try:
            yield read(path)
        except CalibraryError as error:
            yield _of(path, error=str(error))
        if progress is not None:
            progress(done, len(paths), "files")


def _tags_of(path: Path) -> InspectedFile:
    from calibrary.parsers.imagery.tags import list_tags  # noqa: PLC0415  as in _described

    found, left_out = list_tags(path)
    tags = tuple(InspectedTag(name=name, value=value) for name, value in found.items())
    return _of(path, format="image", title="an image's EXIF tags", tags=tags, tags_left_out=left_out)


def _read(path: Path, reading: Reading) -> InspectedFile:
    """Read the calibrations of a file, if necessary without an image size."""
    described = _described(path, reading)
    try:
        return _with_calibrations(described, read_file(path, reading))
    except MissingSizeError as missing:
        try:
            found = read_unsized(path, reading)
        except (FrameError, MissingSizeError):
            # For example a sensor size that does not fit the image sizes that were tried.
            raise missing from None
    return _with_calibrations(described, found)


def _with_calibrations(
    described: InspectedFile, found: Sequence[Calibration | UnsizedCalibration]
) -> InspectedFile:
    whole = tuple(item for item in found if isinstance(item, Calibration))
    unsized = tuple(item for item in found if isinstance(item, UnsizedCalibration))
    reasons = [one.message for item in whole if (one := admission(item)) is not None]
    reasons += [why for item in unsized if (why := why_implausible(item.intrinsics)) is not None]
    implausible = tuple(dict.fromkeys(reasons))
    return replace(described, calibrations=whole, unsized=unsized, implausible=implausible)


def _described(path: Path, reading: Reading) -> InspectedFile:
    """Identify the format and conventions of a file."""
    if reading.format is None and parsers.is_image_file(path):
        from calibrary.parsers.images import image_evidence  # noqa: PLC0415  not needed for calibration files

        evidence = image_evidence(path)
        warnings = [f"{dropped.tag} is not believed: {dropped.reason}" for dropped in evidence.dropped]
        warnings += _contradictions(evidence)
        return _of(path, format="image", title="an image's metadata", warnings=tuple(warnings))
    if reading.format is not None:
        record, reason = format_named(reading.format, path), "you said so"
    else:
        identity = parsers.identify(path, max_bytes=reading.max_bytes)
        record, reason = identity.format, identity.sniff.reason
    sentences = record.convention.sentences() if record.convention is not None else ()
    return _of(path, format=record.name, title=record.title, why=reason, conventions=tuple(sentences))


def _contradictions(evidence: Evidence) -> Iterator[str]:
    """What an image states against the tag that gives its K."""
    from calibrary.jobs.survey import Survey, of_images  # noqa: PLC0415  not needed for calibration files

    claims = of_images(evidence, CameraKey(), FLEET)
    survey = Survey(evidence.scene.metadata, claims, FLEET)
    for own in claims:
        if evidence.chosen is not None and own.name == evidence.chosen.tag:
            yield from (one.message for one in survey.weigh(own).against)


def _of(path: Path, **found: Any) -> InspectedFile:
    folder = str(path.parent)
    return InspectedFile(file=path.name, folder="" if folder == "." else folder, **found)
