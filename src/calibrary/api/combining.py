"""Several calibrations of one camera in, one with its verdict out."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date as Day  # noqa: N812  the argument is called date, as the flag
from pathlib import Path

from msgspec import Struct

from calibrary.api.files import Reading, write
from calibrary.api.stated import CameraLike, overlay
from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.jobs.calibrate_board.entry import require_key
from calibrary.jobs.combine.report import CombinationReport
from calibrary.jobs.combine.run import combine
from calibrary.jobs.combine.sources import read_sources
from calibrary.records import Json, to_json
from calibrary.registry.entry import Entry

__all__ = ["CombineResult", "combine_calibrations"]


class CombineResult(Struct, frozen=True, eq=False):
    """What several calibrations say of their camera together.

    Attributes:
        report: all of it, as the command line shows it.
    """

    report: CombinationReport

    @property
    def verdict(self) -> BoardVerdict:
        """Pass: to be approved; provisional: a draft at most; refuse: two cameras, or nothing to go by."""
        return self.report.verdict

    @property
    def is_good(self) -> bool:
        """Whether it passes."""
        return self.verdict is BoardVerdict.PASS

    @property
    def calibration(self) -> Calibration:
        """The combined one.

        Raises:
            InputError: they were refused.
        """
        if self.report.calibration is None:
            raise InputError("what was refused has no combined calibration; its findings say why")
        return self.report.calibration

    @property
    def entry(self) -> Entry:
        """The registry's entry that it becomes, for :meth:`calibrary.Fleet.propose_entry`.

        Raises:
            InputError: they were refused, or make and model of the camera are not known.
        """
        require_key(self.calibration.camera)
        return Entry.of(self.calibration)

    def write(self, path: str | Path, format: str | None = None) -> tuple[str, ...]:  # noqa: A002  as in api.files
        """Write the combined calibration; returns what the format has no place for.

        Raises:
            InputError: they were refused, or the file cannot be written.
            UnsupportedModelError: the format does not hold this lens.
        """
        return tuple(write(self.calibration, path, format=format).dropped)

    def to_html(self) -> str:
        """The verdict, each calibration against the others and the combined one as a page."""
        from calibrary.jobs.combine.page import combination_page
        from calibrary.pages import render_page

        return render_page(combination_page(self.report))

    def to_dict(self) -> dict[str, Json]:
        """The result as plain data for JSON (schemas/combination-1.schema.json)."""
        return to_json(self.report)


def combine_calibrations(
    sources: Sequence[str | Path],
    *,
    reading: Reading | None = None,
    date: Day | None = None,
    operator: str | None = None,
    camera: CameraLike | None = None,
) -> CombineResult:
    """Weigh several calibrations of one camera into one by their covariances, if they agree.

    Args:
        sources: files that carry a covariance, KEY[@REV] of entries, or the JSON that ``calibrate --json`` prints. Of
            a single one only what it states is judged.
        reading: what the files do not say, and where the registry is.
        date: of the combination; that of the latest when not given.
        operator: who made it.
        camera: what the files do not say of the camera, or say wrong; None fields leave it to them.

    Raises:
        InputError: a file cannot be read, or holds several cameras and none was chosen.
        RegistryError: there is no such entry.
    """
    read = read_sources([str(one) for one in sources], reading or Reading())
    return CombineResult(combine(read, overlay(camera), day=date, operator=operator))
