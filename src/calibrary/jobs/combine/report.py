"""What combining calibrations reports, as one JSON document (schemas/combination-1.schema.json)."""

from __future__ import annotations

from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration
from calibrary.records import Record
from calibrary.validation import Finding

__all__ = ["CombinationReport", "CombinedSource"]


class CombinedSource(Record):
    """One of the calibrations.

    Attributes:
        label: the file, or the entry.
        date: when it was made, as it states it.
        fx: px.
        fx_std: px, its variance factor included; None where none is stated.
        kappa2: its variance factor; None where its σ is that of the program that made it.
        off_px: the farthest it gets from the others together, anywhere in the image; None where that is not known.
        off_std_px: standard deviation of that.
        p: chance of such a difference from the others by the stated noise alone.
    """

    label: str
    date: str | None
    fx: float
    fx_std: float | None
    kappa2: float | None
    off_px: float | None = None
    off_std_px: float | None = None
    p: float | None = None


class CombinationReport(Record, tag_field="schema", tag="combination-1"):
    """Several calibrations of one camera as one, with the verdict.

    Attributes:
        verdict: the worst finding decides.
        findings: the most severe first.
        calibration: the combined one; None where they are refused, since two cameras are never averaged.
        sources: what it is combined from.
        chi2: how far they are from it, by their covariances; None where that was not computed, as the next two.
        dof: degrees of freedom of that.
        p: chance of so much from the stated noise alone.
    """

    verdict: BoardVerdict
    findings: tuple[Finding, ...]
    calibration: Calibration | None
    sources: tuple[CombinedSource, ...]
    chi2: float | None
    dof: int | None
    p: float | None
