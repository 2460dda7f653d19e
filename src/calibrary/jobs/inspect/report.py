"""What inspecting files reports, as JSON documents (schemas/inspect-1 and schemas/inspect-files-1)."""

from __future__ import annotations

from typing import Any

from calibrary.calibration import Calibration
from calibrary.parsers.unsized import UnsizedCalibration
from calibrary.records import Json, Record

__all__ = ["InspectFilesReport", "InspectReport", "InspectedFile"]


class InspectedFile(Record):
    """One file and what it says.

    Attributes:
        file: name without its folder.
        format: None where it could not be recognised.
        why: what was recognised in it.
        conventions: how its numbers count, in sentences.
        calibrations: that it contains.
        unsized: those whose image size the file does not state; written among the calibrations.
        implausible: why a K is that of no camera, for each that is not.
        warnings: what to know of them.
        error: why it was not read; None where it was.
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

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        """All calibrations in one list; those without a size have null for it."""
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
    """What ``calibrary inspect FILE --json`` prints."""


class InspectFilesReport(Record, tag_field="schema", tag="calibrary/inspect-files-1"):
    """What ``calibrary inspect --json`` prints of a folder or of several files.

    Attributes:
        files: in their order.
    """

    files: tuple[InspectedFile, ...]
