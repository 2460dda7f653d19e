"""Result of a calibration, as ``--json`` prints it (schemas/calibration-result-3.schema.json)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

from calibrary import parsers
from calibrary.calib.board import Board
from calibrary.calib.board_shape import Stretch
from calibrary.calib.detection import Detections, NamedRemark
from calibrary.calib.geometry import Geometry
from calibrary.calib.lens_models import Solvable
from calibrary.calib.misfit import Misfit
from calibrary.calib.model_choice import Candidate
from calibrary.calib.result import CalibrationResult, Flown, Rows, ViewResult, finite, rows
from calibrary.calib.verdict import AskedUse, Limits, Uses
from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import InputError, UsageError
from calibrary.jobs.calibrate.outputs import Encode
from calibrary.parsers.writing import format_to_write
from calibrary.records import Record, replace, to_json
from calibrary.registry.entry import VERDICT_BLOCK, Entry, seal
from calibrary.strictyaml import YamlValue
from calibrary.validation import Finding, Use

__all__ = ["Asked", "CalibrateReport", "Use", "Warp", "encoder", "report_of", "require_key"]

ON_BOARD: Final = "board"
"""Kind of provenance of calibrations that name their frames."""
UNITS: Final[Mapping[str, Literal["mm", "squares", "units"]]] = {"mm": "mm", "units": "units"}


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


class Warp(Record):
    """F test for board warp.

    Attributes:
        lift: height of the board's centre above its plane, along x and along y.
        f: the F statistic; None if it overflows a double.
        p: probability of such an F without a warp.
        kept: whether the warp is part of the solution.
    """

    lift: tuple[float, float]
    f: float | None
    p: float
    kept: bool


class CalibrateReport(Record, tag_field="schema", tag="calibration-result-3"):
    """A calibration with its verdict and the evidence for it.

    Attributes:
        verdict: what a solver may do with K; the most severe finding decides.
        uses: what K is good for, with the numbers that decide.
        findings: problems, most severe first, each with its remedy.
        calibration: K and distortion with their quality, and a provenance with date and source images.
        skipped: images that show no board or cannot be read, each with the reason.
        remarks: further remarks on the images that are used.
        notes: remarks on all of them.
        unwritten: why the calibration file was not written; None if it was, or was not asked for.
        dropped: what the format of the calibration file cannot represent.
        target: the board or the points that the images show, in words.
        board: the board; None for points.
        asked: what the solver was asked for.
        model: the lens model, chosen or given.
        candidates: the lens models that were compared.
        warp: test for board warp; None if it was not tested.
        views: all views that were given.
        geometry: poses of the board.
        length_unit: unit of lift, translation and distance: mm; squares if the side of a square is unknown; an
            arbitrary unit for a flight with images that state no positions.
        noise_px: standard deviation of one coordinate, estimated from neighbouring corners.
        condition: condition number of the lens's normal matrix.
        kappa2_by_split: variance factor of each split of the views into halves.
        stretch: of the printed board.
        misfit: known fault that explains residuals that the camera model does not.
        uncertainty_px: of a direction, over the image.
        half_difference_px: difference between halves of the views, over the image.
        limits: the limits used for the verdict.
        versions: of the programs.
        date_origin: source of provenance.date, in words.
        flown: only for a calibration from a flight; ground points take the place of board corners.

    >>> found = calibrary.calibrate("frames", board="checkerboard:9x6", square_mm=40)
    >>> found.verdict.value, found.calibration.quality.views
    ('pass', 10)
    """

    verdict: Use
    uses: Uses
    findings: tuple[Finding, ...]
    calibration: Calibration
    skipped: tuple[NamedRemark, ...]
    remarks: tuple[NamedRemark, ...]
    notes: tuple[str, ...]
    unwritten: str | None
    dropped: tuple[str, ...]
    target: str
    board: Board | None
    asked: Asked
    model: Solvable
    candidates: tuple[Candidate, ...]
    warp: Warp | None
    views: tuple[ViewResult, ...]
    geometry: Geometry
    length_unit: Literal["mm", "squares", "units"]
    noise_px: float | None
    condition: float | None
    kappa2_by_split: tuple[float, ...]
    stretch: Stretch | None
    misfit: Misfit | None
    uncertainty_px: Rows | None
    half_difference_px: tuple[Rows, ...] | None
    limits: Limits
    versions: Mapping[str, str]
    date_origin: str | None
    flown: Flown | None

    @property
    def is_good(self) -> bool:
        """Whether the use that was asked for holds."""
        return self.uses.of(self.asked.use).holds

    @property
    def shots(self) -> str:
        """Word for the views in messages."""
        return "images" if self.flown is not None else "views"

    @property
    def points(self) -> str:
        """Word for what is seen in them."""
        return "points" if self.flown is not None else "corners"

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


def report_of(result: CalibrationResult, detections: Detections, asked: Asked) -> CalibrateReport:
    """Make the report of a solved calibration; numbers that are not finite become None."""
    evidence, halves, board = result.evidence, result.half_difference, result.observations.board
    tested = result.warp
    return CalibrateReport(
        verdict=result.verdict,
        uses=result.uses,
        findings=result.findings,
        calibration=result.calibration,
        skipped=detections.rejected,
        remarks=detections.remarks,
        notes=detections.notes,
        unwritten=None,
        dropped=(),
        target=str(board),
        board=board if isinstance(board, Board) else None,
        asked=asked,
        model=result.model,
        candidates=result.candidates,
        warp=Warp(lift=tested.warp_mm, f=finite(tested.f), p=tested.p, kept=evidence.is_warped)
        if tested
        else None,
        views=result.views,
        geometry=evidence.geometry,
        length_unit=UNITS.get(evidence.unit, "squares"),
        noise_px=evidence.noise_px,
        condition=finite(evidence.condition),
        kappa2_by_split=result.halves.by_split if result.halves is not None else (),
        stretch=evidence.stretch,
        misfit=evidence.misfit,
        uncertainty_px=rows(result.uncertainty.std_px) if result.uncertainty is not None else None,
        half_difference_px=tuple(map(rows, halves.vectors)) if halves is not None else None,
        limits=result.limits,
        versions=result.versions,
        date_origin=result.date_origin,
        flown=result.flown,
    )


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
