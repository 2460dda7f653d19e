"""Calibration and verdict for a camera from a flight: assessed like one from a board, and by the flight's geometry."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Final

import numpy as np

from calibrary.arrays import BoolArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.assessment import Joint, Solved, assess
from calibrary.calib.network import Network, State, linearise
from calibrary.calib.observations import ControlPoints, Observations, View
from calibrary.calib.result import CalibrationResult, ControlFit, FlightGeometry, Flown, OddMark
from calibrary.calib.solve import Solution
from calibrary.calib.verdict import FOCAL, LIMITS, Subject
from calibrary.calib.verdict_rules import size_share
from calibrary.calibration import CameraKey, Grade
from calibrary.errors import CalibrationError
from calibrary.policy import FLEET, Policy
from calibrary.records import replace
from calibrary.sfm.adjust import Adjustment
from calibrary.sfm.advice import helps
from calibrary.sfm.alterations import DISTORTION, Claim, Kind, find_alterations
from calibrary.sfm.bundle import unmoved
from calibrary.sfm.pixel_judging import measured_camera
from calibrary.sfm.sigma import FEATURE_SIDE, FOCAL_BY_PX, CameraUncertainty, camera_uncertainty
from calibrary.validation import Finding, Severity

FLIGHT: Final = "flight"
"""Kind of provenance."""
FEW_IMAGES: Final = 15
LEAST_WEIGHT: Final = 0.01
HELD_WANTED: Final = 0.002
"""Largest relative change of fx if the principal point is held in the centre and the images do not rule that out."""
SINGLE_HEIGHT: Final = 1.15
NADIR_DEG: Final = 12.0
ONE_HEADING_DEG: Final = 45.0
FLAT: Final = 0.03
RMS_WANTED_PX: Final = 1.4
RMS_NEEDED_PX: Final = 3.0
"""Limits in px at the size of feature detection: features of natural surfaces are half as accurate as board corners."""
EDGE_WANTED_PX: Final = 2.0
"""Largest σ of a projection anywhere in the frame, px at the size of feature detection: the next flight has points in
corners where this one had none. Of simulated flights that show all of the frame and were fixed the largest had 1.3."""
MOST_LISTED: Final = 4
WORSE_WANTED: Final = 1.5
"""Largest ratio of actual to stated standard deviation of surveyed points and marks."""
MM: Final = 1000.0


def flight_result(
    found: Adjustment,
    *,
    about: Observations | None = None,
    scale: float = 1.0,
    chosen: str | None = None,
    versions: Mapping[str, str] | None = None,
    claim: Claim | None = None,
    left_out: int = 0,
    policy: Policy = FLEET,
) -> CalibrationResult:
    """Assess the camera as one from a board, with the points of the reconstruction in place of the board.

    Args:
        found: result of the adjustment.
        about: camera, focus, firmware and days as the images state them, and a view with the hash of each file; its
            points are replaced.
        scale: px of the images per px at the size of feature detection.
        chosen: how the images were selected, in words.
        versions: versions of the programs used.
        claim: the stated camera, to compare with what the images show; None if nothing is stated.
        left_out: number of images of the flight that were not chosen.
        policy: limits of σ for each use.

    Raises:
        CalibrationError: the images do not determine a camera.
    """
    known = camera_uncertainty(found)
    observations = _observations(found, known.geometry, about)
    network = Network.of(observations)
    bundle, scene = found.bundle, found.bundle.scene
    images = np.flatnonzero(bundle.tracks.used)
    turns = scene.rotations[images]
    unit = _unit(known.geometry)
    middle = observations.board.points.mean(axis=0)
    places = np.einsum("vij,vj->vi", turns, middle - scene.centres[images] * unit)
    state = State(
        model=scene.model, parameters=scene.parameters, warp=np.zeros(2), rotations=turns, translations=places
    )
    seen = _inliers(found, network)
    linear = linearise(network.only(seen), state)
    if linear is None:
        raise CalibrationError("the reconstruction puts a point behind an image that sees it")
    adjusted = Adjusted(
        network=network.only(seen), state=state, linear=linear, free=np.arange(len(scene.parameters))
    )
    solved = Solved(
        observations=observations,
        usable=observations,
        dropped={},
        solution=Solution(
            adjusted=adjusted, everything=network, repeats=(), warp=None, candidates=found.candidates
        ),
        asked_warp=False,
        shape=None,
        flat_shape=None,
        joint=Joint(covariance=known.covariance, halves=known.halves, rivals=found.rivals),
        versions=versions,
        subject=_subject(known.geometry),
        further=(
            *_judged(known, len(images)),
            *(_of_control(found.control) if found.control is not None else ()),
            *(_as_stated(claim, found, known) if claim is not None else ()),
            *_of_help(found, known, left_out),
        ),
    )
    by = scale / size_share(observations.image_size)
    limits = replace(
        LIMITS,
        rms_wanted_px=RMS_WANTED_PX * by,
        rms_needed_px=RMS_NEEDED_PX * by,
        edge_wanted_px=EDGE_WANTED_PX * scale,
        # Images of a flight share what bends them all, the shutter and the air, and no board was held still for them.
        kappa2_fixed=LIMITS.kappa2_wanted,
    )
    result = assess(solved, limits, policy)
    tag = f"{len(images)} images, {len(observations.board.points)} points"
    made = replace(result.calibration.provenance, kind=FLIGHT, source=None, tag=tag)
    return replace(
        result,
        calibration=replace(result.calibration, provenance=made),
        flown=Flown(
            geometry=known.geometry,
            fx_held=float(known.held.parameters[0]) if known.held is not None else None,
            held_weight=known.held.weight if known.held is not None else 0.0,
            chosen=chosen,
            control=found.control,
            nuisances=known.nuisances,
        ),
    )


def _unit(geometry: FlightGeometry) -> float:
    return MM if geometry.metres else 1.0


def _observations(found: Adjustment, geometry: FlightGeometry, about: Observations | None) -> Observations:
    """Return the reconstruction's points as control points, with their observations, including outliers."""
    bundle, tracks = found.bundle, found.everything
    points, pixels = np.unique(bundle.tracks.point), unmoved(tracks, bundle.scene)
    ids = np.full(int(tracks.point.max()) + 1, -1)
    ids[points] = np.arange(len(points))
    kept = ids[tracks.point] >= 0
    sha256 = {view.name: view.sha256 for view in about.views} if about is not None else {}
    views = []
    for image in np.flatnonzero(bundle.tracks.used).tolist():
        rows = np.flatnonzero(kept & (tracks.image == image))
        name = tracks.names[image]
        views.append(
            View(
                name=name,
                sha256=sha256.get(name),
                ids=ids[tracks.point[rows]],
                image_points=pixels[rows],
            )
        )
    cloud = ControlPoints(
        points=bundle.scene.points[points] * _unit(geometry),
        name="points of the ground",
        unit="mm" if geometry.metres else "units",
    )
    if about is None:
        return Observations(board=cloud, image_size=tracks.image_size, views=tuple(views), camera=CameraKey())
    return replace(about, board=cloud, views=tuple(views))


def _inliers(found: Adjustment, network: Network) -> BoolArray:
    """Return (V, M) which observations are inliers, in the order of the views."""
    seen = network.seen.copy()
    tracks = found.everything
    kept = np.isin(tracks.point, found.bundle.tracks.point)
    for row, image in enumerate(np.flatnonzero(found.bundle.tracks.used).tolist()):
        counts = found.counts[kept & (tracks.image == image)]
        seen[row, : len(counts)] = counts
    return seen


_REMEDIES: Final = {
    "centre-only": "choose images whose edges show ground that others show too",
    "unproven-region": "choose more images (--images) or fly cross strips, so that the corners of images show ground "
    "that others show too",
    "uncertain-edge": "choose more images (--images) or fly cross strips, so that the corners of images show ground "
    "that others show too; until then start from it, or keep it fixed for images cropped to that circle",
    "valid-region": "choose more images, which overlap to their edges",
    "not-monotonic": "choose more images, which overlap to their edges",
    "poor-fit": "leave out images of what moves, such as water and trees in the wind, and of another focus or zoom",
    "lens-model": "choose more images: --images",
    "unknown-uncertainty": "choose more images: --images",
    "no-variance-factor": "choose more images: --images",
    "unstable": "fly slower, with a shorter exposure, or with a mechanical shutter",
    "rolling-shutter": "fly slower, or use the mechanical shutter",
    "motion-blur": "fly slower, or expose shorter",
    "focus-unknown": "state it: --focus; K is for flights with the same focus",
    "focus-not-locked": "lock the focus before the flight",
    "unclear-cause": "look at the images that fit worst",
}
"""Remedies for the pilot of a flight, in place of those for boards."""
_FOR_ONE_MODE: Final[Mapping[Kind, str]] = {
    Kind.DISTORTION_REMOVED: "register this K for images of this kind alone, --capture-mode dewarped, or switch the "
    "correction off in the camera and fly again",
    Kind.DISTORTION_PRESENT: "use this calibration with its distortion, not the tags",
    Kind.ZOOMED: "register this K for this zoom alone: --capture-mode 'zoom 2x'",
    Kind.CROPPED: "use this K for images of this size and crop alone",
}


def _subject(geometry: FlightGeometry) -> Subject:
    """Return a flight in the words of findings."""
    return Subject(
        view="image",
        point="point",
        frames="images",
        remedies=_REMEDIES | {FOCAL: _to_fly(geometry)},
        grade=Grade.ADJUSTED,
    )


def _judged(known: CameraUncertainty, images: int) -> Iterator[Finding]:
    """Yield the findings about the geometry of a flight."""
    geometry, std = known.geometry, known.focal_std
    if images < FEW_IMAGES:
        yield Finding(
            rule="few-images",
            severity=Severity.UNPROVEN,
            measured=images,
            limit=FEW_IMAGES,
            message=f"{images} images were reconstructed, need {FEW_IMAGES}",
            remedy="choose more images that overlap: --images",
        )
    if not known.separates_height:
        why = ", ".join(_shortcomings(geometry))
        yield Finding(
            rule="focal-length-or-height",
            severity=Severity.UNPROVEN,
            measured=geometry.focal_by_px,
            limit=FOCAL_BY_PX,
            message="focal length and flying height cannot be told apart"
            + (f": {why}" if why else "")
            + f". A tenth of a pixel of systematic error, in images reduced to {FEATURE_SIDE} px, may move fx by "
            f"{geometry.focal_by_px / 10:.0%}; "
            + (
                f"fx = {known.fx:.0f} px within {3 * std:.0%} (3 σ), all of that included"
                if 3 * std < 1
                else "not even its order of magnitude is certain"
            ),
            remedy=_to_fly(geometry),
        )
    if known.unknown:
        yield Finding(
            rule="unknown-uncertainty",
            severity=Severity.UNPROVEN,
            message=f"σ is incomplete: {' and '.join(known.unknown)} cannot be computed from these images",
            remedy=_REMEDIES["unknown-uncertainty"],
        )
    held = known.held
    if held is not None:
        change = float(held.parameters[0]) / held.free_fx - 1
        if held.weight > LEAST_WEIGHT and abs(change) > HELD_WANTED:
            yield Finding(
                rule="principal-point",
                severity=Severity.UNPROVEN,
                measured=abs(change),
                limit=HELD_WANTED,
                message=f"with the principal point held in the middle of the image fx is {held.parameters[0]:.1f} px, "
                f"with it free {held.free_fx:.1f} px ({change:+.2%}), and this flight does not say which is right; σ "
                "includes the difference",
                remedy="fly strips across the others, so that images of the same ground are turned by 90°",
            )
    if not geometry.metres:
        yield Finding(
            rule="no-positions",
            severity=Severity.NOTE,
            message="fewer than three images state where they were taken, so distances have no scale; K needs none",
        )


def _of_help(found: Adjustment, known: CameraUncertainty, left_out: int) -> Iterator[Finding]:
    """Yield what would help this flight now."""
    if measures := helps(found.bundle, known, left_out):
        listed = "; ".join(f"{one.measure} (σ of fx {one.sigma:.2%})" for one in measures)
        yield Finding(
            rule="would-help",
            severity=Severity.NOTE,
            measured=measures[0].sigma,
            message=f"what would help this flight as it is: {listed}",
        )


def _of_control(fit: ControlFit) -> Iterator[Finding]:
    """Yield the findings about ground control."""
    if fit.rejected:
        listed = "; ".join(islice(_odd_points(fit.rejected), MOST_LISTED))
        yield Finding(
            rule="marks-rejected",
            severity=Severity.WARNING,
            measured=len(fit.rejected),
            message=f"{len(fit.rejected)} of {fit.marks + len(fit.rejected)} marks of ground control do not fit the "
            f"others and were left out: {listed}",
            remedy="a point that is off in all images has a wrong coordinate or another's name, one that is off in one "
            "image a wrong mark there",
        )
    if fit.worse > WORSE_WANTED:
        yield Finding(
            rule="points-less-certain",
            severity=Severity.WARNING,
            measured=fit.worse,
            limit=WORSE_WANTED,
            message=f"ground control fits {fit.worse:.1f} times worse than stated, and its σ was multiplied by that",
            remedy="state how good it is, --points-std-m and --mark-std-px, or look for what is wrong with it",
        )


def _odd_points(rejected: Sequence[OddMark]) -> Iterator[str]:
    """Yield a text for each point with the images in which it does not fit."""
    for point in dict.fromkeys(one.point for one in rejected):
        marks = [one for one in rejected if one.point == point]
        off = max((one.off_px for one in marks if one.off_px is not None), default=None)
        where = marks[0].image if len(marks) == 1 else f"{len(marks)} images, such as {marks[0].image}"
        far = f"up to {off:.0f} px off" if off is not None else "behind the camera"
        yield f"{point} in {where} ({far})"


def _as_stated(claim: Claim, found: Adjustment, known: CameraUncertainty) -> Iterator[Finding]:
    """Yield findings about alterations of the images by the camera, as far as the flight can show them.

    K is valid for the images as they are.
    """
    for one in find_alterations(claim, measured_camera(found, known)):
        if known.separates_height or one.kind in DISTORTION:
            yield Finding(
                rule=one.kind.value,
                severity=Severity.WARNING,
                measured=one.measured,
                limit=one.stated,
                message=one.message,
                remedy=_FOR_ONE_MODE[one.kind],
            )


def _to_fly(geometry: FlightGeometry) -> str:
    """Return what to fly or to choose so that the images determine the focal length."""
    lacking = []
    if geometry.height_ratio < SINGLE_HEIGHT:
        lacking.append("cross strips at a second height (half as high again)")
    if geometry.tilt_deg < NADIR_DEG:
        lacking.append("a few oblique images of 30°")
    if lacking:
        return f"fly {' or '.join(lacking)}, and give more images: --images"
    return "choose more images, --images, or fly more oblique strips, from several directions"


def _shortcomings(geometry: FlightGeometry) -> Iterator[str]:
    """Yield the weaknesses of the flight's geometry."""
    if geometry.height_ratio < SINGLE_HEIGHT:
        yield f"all images are from one height (highest ÷ lowest {geometry.height_ratio:.2f})"
    if geometry.tilt_deg < NADIR_DEG:
        yield f"all look straight down (nine of ten within {geometry.tilt_deg:.0f}°)"
    if geometry.relief < FLAT:
        yield f"the ground is flat ({geometry.relief:.1%} of the flying height)"
    if geometry.headings_deg < ONE_HEADING_DEG:
        yield "all strips run along one line"
