"""JSON documents of an inspection (schemas/inspect-1 and schemas/inspect-files-1)."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta

from calibrary.calibration import Calibration
from calibrary.parsers.unsized import UnsizedCalibration
from calibrary.records import Json, Record

__all__ = ["InspectFilesReport", "InspectReport", "InspectedFile", "InspectedTag"]


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
        format: name of the format; None if it was not recognised.
        why: content by which the format was recognised.
        conventions: conventions of its numbers, in sentences.
        calibrations: calibrations in the file.
        unsized: calibrations without an image size; written among the calibrations.
        implausible: reason for each K that no camera can have.
        warnings: on the calibrations.
        error: reason why the file was not read; None if it was.
        tags: EXIF tags of an image; None if they were not requested.
        tags_left_out: number of tags left out: positions, serial numbers, people's names, thumbnails and other
            binary values, tags without a known name.
    """

    file: str
    format: str | None
    why: str | None
    conventions: tuple[str, ...]
    calibrations: tuple[Calibration, ...]
    unsized: tuple[UnsizedCalibration, ...]
    implausible: tuple[str, ...]
    warnings: tuple[str, ...]
    error: str | None
    tags: tuple[InspectedTag, ...] | None = None
    tags_left_out: Annotated[int, Meta(ge=0)] = 0

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
