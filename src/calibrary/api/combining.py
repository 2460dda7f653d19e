"""Combination of several calibrations of one camera."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date as Day  # noqa: N812  the argument is called date, like the flag
from pathlib import Path

from msgspec import Struct

from calibrary.arguments import CameraLike, Place, Reading, overlay
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.jobs.calibrate.entry import require_key
from calibrary.jobs.combine.report import CombinationReport
from calibrary.jobs.combine.run import combine
from calibrary.jobs.combine.sources import read_sources
from calibrary.jobs.files import write
from calibrary.records import Json, to_json
from calibrary.registry.entry import Entry

__all__ = ["CombineResult", "combine_calibrations"]


class CombineResult(Struct, frozen=True, eq=False):
    """Result of combining several calibrations of one camera.

    Attributes:
        report: complete result, as the command line shows it.
    """

    report: CombinationReport

    @property
    def verdict(self) -> BoardVerdict:
        """Pass: ready for approval; provisional: a draft at most; refuse: two cameras, or not enough information."""
        return self.report.verdict

    @property
    def is_good(self) -> bool:
        """Whether the verdict is pass."""
        return self.verdict is BoardVerdict.PASS

    @property
    def calibration(self) -> Calibration:
        """The combined calibration.

        Raises:
            InputError: the combination was refused.
        """
        if self.report.calibration is None:
            raise InputError("what was refused has no combined calibration; its findings say why")
        return self.report.calibration

    @property
    def entry(self) -> Entry:
        """Return the registry entry for the combination, for :meth:`calibrary.Fleet.propose_entry`.

        Raises:
            InputError: the combination was refused, or make and model of the camera are unknown.
        """
        require_key(self.calibration.camera)
        return Entry.of(self.calibration)

    def write(self, path: str | Path, format: str | None = None) -> tuple[str, ...]:  # noqa: A002  as in api.files
        """Write the combined calibration; return what the format cannot represent.

        Raises:
            InputError: the combination was refused, or the file cannot be written.
            UnsupportedModelError: the format cannot represent this lens.
        """
        return tuple(write(self.calibration, path, format=format).dropped)

    def to_html(self) -> str:
        """Return the verdict and the comparison of the calibrations with each other and the combined one, as a page."""
        from calibrary.jobs.combine.page import combination_page
        from calibrary.pages import render_page

        return render_page(combination_page(self.report))

    def to_dict(self) -> dict[str, Json]:
        """Return the result as plain data for JSON (schemas/combination-1.schema.json)."""
        return to_json(self.report)


def combine_calibrations(
    sources: Sequence[str | Path],
    *,
    reading: Reading | None = None,
    registry: Place | None = None,
    date: Day | None = None,
    operator: str | None = None,
    camera: CameraLike | None = None,
) -> CombineResult:
    """Combine several calibrations of one camera, weighted by their covariances, if they agree.

    Args:
        sources: files with a covariance, KEY[@REV] of entries, or the JSON that ``calibrate --json`` prints. A single
            source is only checked.
        reading: settings for the files.
        registry: the registry of the entries.
        date: date of the combination; by default that of the latest calibration.
        operator: person who made the combination.
        camera: facts about the camera that the files do not state or state wrongly; fields that are None are taken
            from the files.

    Raises:
        InputError: a file cannot be read, or contains several cameras and none was selected.
        RegistryError: an entry does not exist.
    """
    read = read_sources([str(one) for one in sources], reading or Reading(), registry)
    return CombineResult(combine(read, overlay(camera), day=date, operator=operator))
