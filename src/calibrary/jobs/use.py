"""What a solver may do with a K: keep it fixed, start from it, or leave it.

Users of Metashape, ODM, COLMAP and Pix4D decide this one thing with a calibration. It follows from the uncertainty of
its projections over the frame, with the camera free to turn, and of its focal length, against the policy's limits. A K
without an uncertainty is a start, however it was made: "measured" does not say how well.
"""

from __future__ import annotations

from typing import Final

from calibrary.arrays import np
from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import CalibrationError
from calibrary.policy import Policy
from calibrary.probability import two_digits, whole_percent
from calibrary.quality import Proven
from calibrary.records import Record
from calibrary.validation import Use

OF_SIGMA: Final = frozenset({"uncertain-focal-length", "unproven-region"})
"""Rules of a calibration that hold its standard deviations against the policy's limits, and nothing else."""


class Allowed(Record):
    """What a solver may do with a K, and why.

    Attributes:
        use: what it may do.
        why: reason, in a few words.
        sigma_px: largest standard deviation of a projection over the frame, or where observations prove it, px; None
            if it is unknown.
        sigma_focal: standard deviation of fx as a fraction of fx; None if it is unknown.
    """

    use: Use
    why: str
    sigma_px: float | None = None
    sigma_focal: float | None = None


def allowed(
    calibration: Calibration | None, policy: Policy, *, is_valid: bool = True, resaved: bool = False
) -> Allowed:
    """Return what a solver may do with a judged K.

    Args:
        calibration: the K; None if there is none.
        policy: with the limits of a K that is kept fixed.
        is_valid: whether it was judged valid; no other may be used.
        resaved: whether it is not valid only because a program saved the images again.
    """
    if calibration is None or not is_valid:
        use = Use.NONE if calibration is None or not resaved else Use.START
        saved = "a program saved the images again, and may have changed their frame"
        return Allowed(use=use, why="no valid K" if use is Use.NONE else saved)
    if calibration.shortfall is not None and not _is_short_by_sigma(calibration):
        # However small its σ: what it failed may be what σ does not know of.
        return _short(calibration)
    if isinstance(calibration.distortion, NoDistortion) and not calibration.grade.is_measured:
        return Allowed(use=Use.START, why="it has no distortion, and the focal length was not measured")
    if calibration.distortion is None:
        return Allowed(use=Use.START, why="the distortion is unknown and starts from zero")
    if not calibration.grade.is_measured:
        return Allowed(use=Use.START, why="focal length and distortion were not measured on this unit")
    quality = calibration.quality
    if quality is None or not (quality.covariance is not None or {"fx", "fy"} <= quality.std.keys()):
        made = calibration.provenance
        # What a registry answers with says in its tag where the entry is from.
        kind = (made.tag or "").partition(" ")[0] if made.kind == "registry" else made.kind
        granted = policy.maker_sigma_px if kind == "image-metadata" else None
        if granted is not None and granted <= policy.fixed_sigma_px:
            return Allowed(
                use=Use.FIXED,
                why=f"the policy {policy.name} grants a maker's calibration {granted:g} px",
                sigma_px=granted,
            )
        return Allowed(use=Use.START, why="it was measured, and how well is not stated")
    return _by_sigma(calibration, policy)


def _is_short_by_sigma(calibration: Calibration) -> bool:
    """Whether a calibration is a start for its standard deviations alone, which the policy at hand judges again."""
    said = {note.partition(": ")[0] for note in calibration.notes} - {calibration.shortfall}
    return calibration.shortfall == Use.START and bool(said) and said <= OF_SIGMA


def _short(calibration: Calibration) -> Allowed:
    """A calibration that was judged a start at most, with how far its focal length may be off as it states itself."""
    from calibrary.jobs.diff.uncertainty import std_of  # noqa: PLC0415  for the few that have a σ

    if calibration.shortfall == Use.NONE:
        return Allowed(use=Use.NONE, why="its calibration was judged: it was refused")
    focal = std_of(calibration, "fx") / calibration.intrinsics.fx
    within = f"; fx may be off by {3 * focal:.2%} (3 σ)" if focal else ""
    return Allowed(
        use=Use.START,
        why=f"its calibration was judged: a start only{within}",
        sigma_focal=focal or None,
    )


def _by_sigma(calibration: Calibration, policy: Policy) -> Allowed:
    # What propagates a covariance is loaded for the few calibrations that have one.
    from calibrary.calib.projection_difference import projection_uncertainty  # noqa: PLC0415  the reason above
    from calibrary.jobs.diff.uncertainty import spread_of, std_of  # noqa: PLC0415  as above

    focal = std_of(calibration, "fx") / calibration.intrinsics.fx
    proven = calibration.quality.proven if calibration.quality is not None else None
    if proven is not None:
        return _where_proven(proven, focal, policy)
    try:
        over_frame = projection_uncertainty(calibration, spread_of(calibration).known).std_px
    except CalibrationError as error:
        return Allowed(
            use=Use.START, why=f"its uncertainty over the frame is unknown: {error}", sigma_focal=focal
        )
    sigma = float(np.nanmax(over_frame))
    holds = sigma <= policy.fixed_sigma_px and focal <= policy.fixed_sigma_focal
    known = f"known to {two_digits(sigma)} px over the frame and {focal:.2%} of f"
    limit = f"; to keep it fixed {policy.fixed_sigma_px:g} px and {policy.fixed_sigma_focal:.2%} are needed"
    return Allowed(
        use=Use.FIXED if holds else Use.START,
        why=known if holds else known + limit,
        sigma_px=sigma,
        sigma_focal=focal,
    )


def _where_proven(proven: Proven, focal: float, policy: Policy) -> Allowed:
    sigma, image = proven.sigma_px, "frame" if proven.circle_px is None else "image circle"
    holds = (
        sigma is not None
        and sigma <= policy.fixed_sigma_px
        and proven.share >= policy.fixed_share
        and focal <= policy.fixed_sigma_focal
    )
    within = (
        f"to {two_digits(sigma)} px within {proven.radius_px:.0f} px of the middle"
        if sigma is not None
        else "nowhere"
    )
    known = f"known {within} ({whole_percent(proven.share)} of the {image}) and to {focal:.2%} of f"
    limit = (
        f"; to keep it fixed {policy.fixed_sigma_px:g} px over {policy.fixed_share:.0%} and "
        f"{policy.fixed_sigma_focal:.2%} are needed"
    )
    return Allowed(
        use=Use.FIXED if holds else Use.START,
        why=known if holds else known + limit,
        sigma_px=sigma,
        sigma_focal=focal,
    )
