"""What inspecting files reports, as JSON documents (schemas/inspect-1 and schemas/inspect-files-1)."""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.records import Record

__all__ = ["InspectFilesReport", "InspectReport", "InspectedFile"]


class InspectedFile(Record):
    """One file and what it says.

    Attributes:
        file: name without its folder.
        format: None where it could not be recognised.
        why: what was recognised in it.
        conventions: how its numbers count, in sentences.
        calibrations: that it contains.
        warnings: what to know of them.
        error: why it was not read; None where it was.
    """

    file: str
    format: str | None
    why: str | None
    conventions: tuple[str, ...]
    calibrations: tuple[Calibration, ...]
    warnings: tuple[str, ...]
    error: str | None


class InspectReport(InspectedFile, tag_field="schema", tag="calibrary/inspect-1"):
    """What ``calibrary inspect FILE --json`` prints."""


class InspectFilesReport(Record, tag_field="schema", tag="calibrary/inspect-files-1"):
    """What ``calibrary inspect --json`` prints of a folder or of several files.

    Attributes:
        files: in their order.
    """

    files: tuple[InspectedFile, ...]
