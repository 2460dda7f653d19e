"""Result of a calibration, as ``--json`` prints it (schemas/calibration-result-3.schema.json)."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Self

from calibrary import parsers
from calibrary.calib.detection import Detections, NamedRemark
from calibrary.calib.result import CalibrationResult
from calibrary.calib.verdict import AskedUse
from calibrary.calibration import CameraKey
from calibrary.errors import InputError, UsageError
from calibrary.jobs.calibrate.outputs import Encode
from calibrary.parsers.writing import format_to_write
from calibrary.records import Record, replace, to_json
from calibrary.registry.entry import VERDICT_BLOCK, Entry, seal
from calibrary.strictyaml import YamlValue
from calibrary.validation import Use

__all__ = ["Asked", "CalibrateReport", "Use", "encoder", "require_key"]

ON_BOARD: Final = "board"
"""Kind of provenance of calibrations that name their frames."""


class Asked(Record):
    """What the solver was asked for.

    Attributes:
        model: a lens model, or auto.
        warp: whether the board's warp may be solved for.
        guess_fx: fx of the K to start from, px; None if none was given.
        use: the use that has to hold.
    """

    model: str = "auto"
    warp: bool = True
    guess_fx: float | None = None
    use: AskedUse = AskedUse.FIXED


class CalibrateReport(CalibrationResult, tag_field="schema", tag="calibration-result-3"):
    """A calibration with its verdict and the evidence for it, and what the job says besides.

    Attributes:
        skipped: images that show no board or cannot be read, each with the reason.
        remarks: further remarks on the images that are used.
        notes: remarks on all of them.
        unwritten: why the calibration file was not written; None if it was, or was not asked for.
        dropped: what the format of the calibration file cannot represent.
        asked: what the solver was asked for.

    >>> found = calibrary.calibrate("frames", board="checkerboard:9x6", square_mm=40)
    >>> found.verdict.value, found.calibration.quality.views
    ('fixed', 10)
    """

    skipped: tuple[NamedRemark, ...]
    remarks: tuple[NamedRemark, ...]
    notes: tuple[str, ...]
    unwritten: str | None = None
    dropped: tuple[str, ...] = ()
    asked: Asked

    @classmethod
    def of(cls, result: CalibrationResult, detections: Detections, asked: Asked) -> Self:
        """Add to a result what was asked for, and what is said of the images."""
        return cls(
            **{name: getattr(result, name) for name in result.__struct_fields__},
            skipped=detections.rejected,
            remarks=detections.remarks,
            notes=detections.notes,
            asked=asked,
        )

    @property
    def is_good(self) -> bool:
        """Whether the use that was asked for holds."""
        return self.uses.of(self.asked.use).holds

    @property
    def entry(self) -> Entry:
        """The registry entry for this calibration, for :meth:`calibrary.Fleet.propose_entries`.

        Raises:
            InputError: the calibration is refused, make or model of its camera is unknown, or it is not from frames.
        """
        if self.verdict is Use.NONE:
            raise InputError("a calibration that was refused becomes no entry; its report says what to do")
        require_key(self.calibration.camera)
        made = self.calibration.provenance
        if made.kind == ON_BOARD and not made.sources:
            raise InputError(
                "the corners do not say which frames they were seen in (no sha256), and an entry has to; calibrate "
                "from the frames"
            )
        return replace(Entry.of(self.calibration), extensions={VERDICT_BLOCK: self._solve_block()})

    def _solve_block(self) -> dict[str, YamlValue]:
        """The entry's block on the solve: what it takes to judge it, and to repeat it."""
        board = to_json(self.board) if self.board is not None else None
        how: dict[str, YamlValue] = {
            "board": {name: value for name, value in board.items() if value is not None}
            if board
            else self.target,
            "asked": to_json(self.asked),
            "model": self.model.value,
            f"warp_{self.length_unit}": list(self.warp.lift)
            if self.warp is not None and self.warp.kept
            else None,
            "noise_px": self.noise_px,
            "tilt_spread_deg": self.geometry.tilt_spread_deg,
            "depth_ratio": self.geometry.depth_ratio,
            "reach": self.geometry.coverage.reach,
            "left_out": {view.name: view.without.reason.value for view in self.views if view.without},
            "corners_left_out": sum(len(view.corners_out) for view in self.views),
            "date_origin": self.date_origin,
            "programs": dict(self.versions),
        }
        block = seal(self.calibration, self.verdict.value, [one.rule for one in self.findings], how)
        return {name: value for name, value in block.items() if value not in (None, {}, [])}


def encoder(to: str | None, file: Path) -> Encode[CalibrateReport]:
    """Return what writes K and distortion in a format, or in that of the file's suffix.

    Raises:
        UsageError: the format has no place for a distortion.
        InputError: there is no such format, or the suffix does not determine one.
    """
    record = format_to_write(to, file, flag="--to")
    if record.capacity is not None and not record.capacity.has_lens:
        raise UsageError(
            f"a {record.name} file has no place for the distortion that a calibration finds; expected another "
            "format, from which 'calibrary convert' makes such a file with --drop-distortion",
            source=str(file),
            place="--out",
        )

    def encode(report: CalibrateReport, name: str) -> tuple[bytes, CalibrateReport]:
        content, verdict = parsers.encode([report.calibration], record, name=name)
        return content, replace(report, dropped=tuple(verdict.dropped))

    return encode


def require_key(camera: CameraKey) -> None:
    """Check that the camera has the fields by which an entry is found.

    Raises:
        InputError: make or model is unknown.
    """
    flag_of = {"make": "--make", "model": "--model"}
    missing = [name for name in flag_of if not (getattr(camera, name) or "").strip()]
    if missing:
        flags = " ".join(f"{flag_of[name]} NAME" for name in missing)
        raise InputError(
            f"the frames do not say the camera's {' and '.join(missing)}, by which its entry is found; say {flags}, "
            "or --as KEY for a camera that has one"
        )
