"""Result of a combination, as ``--json`` prints it (schemas/combination-2.schema.json)."""

from __future__ import annotations

from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.jobs.calibrate.report import require_key
from calibrary.records import Record, replace
from calibrary.registry.entry import VERDICT_BLOCK, Entry, seal
from calibrary.sfm.season import Drift
from calibrary.strictyaml import YamlValue
from calibrary.validation import Finding, Severity


class CombinedSource(Record):
    """One of the calibrations.

    Attributes:
        label: name of the file or entry.
        date: stated date of the calibration.
        fx: fx, px.
        fx_std: standard deviation of fx including the variance factor, px; None if not stated.
        kappa2: variance factor; None if the σ is that of the program that made the calibration.
        off_px: largest difference from all others together, anywhere in the image, px; None if not known.
        off_std_px: standard deviation of off_px.
        p: probability of such a difference from the others by the stated noise alone.
    """

    label: str
    date: str | None
    fx: float
    fx_std: float | None
    kappa2: float | None
    off_px: float | None = None
    off_std_px: float | None = None
    p: float | None = None


class CombinationReport(Record, tag_field="schema", tag="combination-2"):
    """Combination of several calibrations of one camera, with the verdict.

    Attributes:
        verdict: pass: ready for approval; provisional: a draft at most; refuse: two cameras, or not enough information.
            The most severe finding decides.
        findings: problems, most severe first.
        unwritten: why the calibration file was not written; None if it was, or was not asked for.
        dropped: what the format of the calibration file cannot represent.
        calibration: the combined calibration; None if refused, because different cameras are never averaged.
        sources: the calibrations that were combined.
        chi2: χ² of their differences from the combined one; None if not computed, like dof and p.
        dof: degrees of freedom of chi2.
        p: probability of such a chi2 from the stated noise alone.
        drift: how the camera changed from flight to flight; None if no flights were solved together, or their days are
            not known or within a month.
    """

    verdict: BoardVerdict
    findings: tuple[Finding, ...]
    unwritten: str | None
    dropped: tuple[str, ...]
    calibration: Calibration | None
    sources: tuple[CombinedSource, ...]
    chi2: float | None
    dof: int | None
    p: float | None
    drift: Drift | None = None

    @property
    def is_good(self) -> bool:
        """Whether the verdict is pass."""
        return self.verdict is BoardVerdict.PASS

    @property
    def entry(self) -> Entry:
        """The registry entry for the combination, for :meth:`calibrary.Fleet.propose_entries`.

        Raises:
            InputError: the combination was refused, or make and model of the camera are unknown.
        """
        if self.calibration is None:
            raise InputError("what was refused has no combined calibration; its findings say why")
        require_key(self.calibration.camera)
        reasons = [one.rule for one in self.findings if one.severity is not Severity.NOTE]
        how: dict[str, YamlValue] = {
            "combined_from": [one.label for one in self.sources],
            **({"chi2": self.chi2, "dof": self.dof} if self.chi2 is not None else {}),
        }
        block = seal(self.calibration, self.verdict.value, reasons, how)
        return replace(Entry.of(self.calibration), extensions={VERDICT_BLOCK: block})
