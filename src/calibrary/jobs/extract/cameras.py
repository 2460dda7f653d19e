"""From camera states to cameras: which states are one camera, what its K is, and whether it may be used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from calibrary.calibration import Calibration, CameraKey, Intrinsics
from calibrary.catalogue.sensor_widths import sensor_width
from calibrary.errors import FrameError
from calibrary.evidence.collect import Evidence, collect
from calibrary.evidence.conflict import disagreement
from calibrary.evidence.context import Scene
from calibrary.evidence.edits import edits
from calibrary.evidence.estimate import Source, SourceEstimate
from calibrary.evidence.frame import adapt
from calibrary.evidence.identity import camera_key
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.extract.knowledge import Knowledge, Known
from calibrary.known_camera import SensorWidth
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.validation import Circumstances, Expected, NamedFocal, Report, Verdict, validate

__all__ = ["DEFAULT_SENSOR_MM", "Camera", "Sensor", "State", "circumstances", "group_cameras", "judge"]

DEFAULT_SENSOR_MM = (13.2, 8.8)
"""The nominal 1-inch sensor, the default of the source document."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """Sensor size used when neither the image nor the catalogue states one.

    Attributes:
        size_mm: (width, height); a side is None where only the other was stated.
        given: whether the user stated it; else it is the default, an assumption.
    """

    size_mm: tuple[float | None, float | None]
    given: bool

    def sides(self, metadata: ImageMetadata) -> tuple[float, float]:
        """Both sides in mm; one that was not stated follows from square pixels."""
        width, height = self.size_mm
        w_px, h_px = metadata.size
        if width is not None:
            return width, height if height is not None else width * h_px / w_px
        height = height if height is not None else DEFAULT_SENSOR_MM[1]
        return height * w_px / h_px, height


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """One camera state: equal metadata, and the images that carry it."""

    metadata: ImageMetadata
    names: tuple[str, ...]
    known: Known


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """One camera of the run.

    Attributes:
        key: which camera.
        states: its states, the one with most images first.
        evidence: of the state whose K stands for the camera.
        calibration: the K to use, None when there is none.
        report: the calibration against the policy, None without one.
        spread: how far K's numbers spread over the states, as a share of fx; None with one state.
        no_k_reason: in one line, when there is no K at all.
        no_k_remedy: what to do about that.
    """

    key: CameraKey
    states: tuple[State, ...]
    evidence: Evidence
    calibration: Calibration | None
    report: Report | None
    spread: float | None = None
    no_k_reason: str | None = None
    no_k_remedy: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Every image of this camera."""
        return tuple(name for state in self.states for name in state.names)

    @property
    def verdict(self) -> Verdict:
        """Verdict of the report; REJECTED if there is no K."""
        return self.report.verdict if self.report is not None else Verdict.REJECTED

    @property
    def reason(self) -> str | None:
        """Why the K is not valid, in one line; None for a valid one."""
        if self.report is None:
            return self.no_k_reason
        return self.report.failures[0].message if self.report.failures else None

    @property
    def remedy(self) -> str | None:
        """What to do about that, None for a valid K."""
        return self.report.remedy if self.report is not None else self.no_k_remedy


def group_cameras(
    states: Mapping[ImageMetadata, Sequence[str]], knowledge: Knowledge
) -> dict[CameraKey, tuple[State, ...]]:
    """Put camera states together that are one camera, the commonest state first."""
    cameras: dict[CameraKey, list[State]] = {}
    for metadata, names in states.items():
        known = knowledge.of(metadata)
        inferred = known.camera.sub_camera if known.camera is not None else None
        key = camera_key(metadata, inferred)
        cameras.setdefault(key, []).append(State(metadata=metadata, names=tuple(names), known=known))
    ordered = sorted(cameras.items(), key=lambda item: str(item[0]))
    return {key: tuple(sorted(group, key=lambda s: (-len(s.names), s.names[0]))) for key, group in ordered}


def judge(
    key: CameraKey,
    states: Sequence[State],
    *,
    policy: Policy,
    sensor: Sensor,
) -> Camera:
    """Choose one camera's K and hold it against the policy.

    The K is one that an image carries, never an average: of the states with the best-graded estimate, the one
    with most images. The others are measured against it.
    """
    heard = [(state, collect(scene_of(state, sensor, policy))) for state in states]
    with_k = [(state, evidence) for state, evidence in heard if evidence.chosen is not None]
    if not with_k:
        state, evidence = heard[0]
        reason, remedy = _no_k(state, evidence)
        return Camera(
            key=key,
            states=tuple(states),
            evidence=evidence,
            calibration=None,
            report=None,
            no_k_reason=reason,
            no_k_remedy=remedy,
        )
    best_grade = min(evidence.chosen.rank[0] for _, evidence in with_k if evidence.chosen)
    state, evidence = next((s, e) for s, e in with_k if e.chosen and e.chosen.rank[0] == best_grade)
    calibration = evidence.calibration(_dated(key, states), source_name=state.names[0].rsplit("/", 1)[-1])
    spread = _spread([e.chosen for _, e in with_k if e.chosen], evidence)
    around = circumstances(evidence, state.known, spread=spread)
    report = validate(calibration, policy, around) if calibration is not None else None
    return Camera(
        key=key,
        states=tuple(states),
        evidence=evidence,
        calibration=calibration,
        report=report,
        spread=spread,
    )


def scene_of(state: State, sensor: Sensor, policy: Policy) -> Scene:
    """What a state's sources are read against.

    Of a camera that neither catalogue nor registry knows anything of, the sources are weighed against each other
    where the policy settles by that; the sensor databases are asked then, and only then.
    """
    sides, camera = sensor.sides(state.metadata), state.known.camera
    knows = camera is not None and (camera.pitch_um is not None or camera.fx_over_w is not None)
    weighs = policy.independent_sources_settle and not knows and state.known.calibration is None
    return Scene(
        metadata=state.metadata,
        known=camera,
        siblings=state.known.siblings,
        given_sensor_mm=sides if sensor.given else None,
        # A default sensor under a camera that is known would only be wrong with more digits.
        assumed_sensor_mm=None if sensor.given or knows or state.known.calibration is not None else sides,
        weighs=weighs,
        listed=_listed(state) if weighs else None,
    )


def _listed(state: State) -> SensorWidth | None:
    camera = state.known.camera
    if camera is not None and camera.sensor_width_mm is not None:
        return SensorWidth(camera.sensor_width_mm, "the catalogue")
    return sensor_width(state.metadata.make, state.metadata.model)


def circumstances(evidence: Evidence, known: Known, *, spread: float | None = None) -> Circumstances:
    """What is known around the chosen estimate of one image."""
    chosen = evidence.chosen
    metadata = evidence.scene.metadata
    causes = {conflict.other: conflict.cause.value for conflict in evidence.conflicts}
    return Circumstances(
        expected=_expected(metadata, known),
        others=tuple(
            NamedFocal(
                name=estimate.tag,
                fx=estimate.intrinsics.fx,
                tolerance=estimate.tolerance,
                cause=causes.get(estimate),
                independent=chosen is None or estimate.is_independent_of(chosen),
                confirms_within=estimate.confirms_within(chosen) if chosen is not None else None,
            )
            for estimate in evidence.estimates
            if estimate is not chosen
        ),
        focal_mm=metadata.focal_mm,
        focal_35mm=metadata.focal_35mm,
        weighed=evidence.scene.weighs,
        sensor_assumed=chosen is not None and chosen.source is Source.ASSUMED_SENSOR,
        sensor_given=chosen is not None and chosen.source is Source.GIVEN_SENSOR,
        zoomed=metadata.zoom > 1.0,
        edits=edits(metadata),
        spread=spread,
    )


def _expected(metadata: ImageMetadata, known: Known) -> Expected | None:
    """The known camera's focal length in the file's frame, None where it is not known there."""
    if known.resolution is not None:
        return Expected(
            fx=known.resolution.calibration.intrinsics.fx,
            tolerance=known.resolution.entry.tolerance,
            source="registry",
        )
    camera = known.camera
    over_width = camera.fx_over_w_at(metadata.focal_mm) if camera is not None else None
    if camera is None or over_width is None or camera.native_size is None:
        return None
    width, height = camera.native_size
    focal = over_width * width
    native = Intrinsics(fx=focal, fy=focal, cx=width / 2, cy=height / 2, image_size=(width, height))
    try:
        fx = adapt(native, metadata).intrinsics.fx
    except FrameError:
        return None
    return Expected(fx=fx, spread=camera.spread, source="catalogue", by_exif_focal=camera.fx_over_w is None)


def _spread(estimates: Sequence[SourceEstimate], evidence: Evidence) -> float | None:
    """The largest (max − min) of fx, fy, cx, cy over the states as a share of fx, None with one state.

    A state whose calibration tags were lost says less, not something else: it counts only where its focal
    length is another camera's.
    """
    chosen = evidence.chosen
    if chosen is None or len(estimates) < 2:
        return None
    equals = [w.intrinsics for w in estimates if w.rank[0] == chosen.rank[0] or disagreement(chosen, w)]
    ranges = (
        max(getattr(K, name) for K in equals) - min(getattr(K, name) for K in equals)
        for name in ("fx", "fy", "cx", "cy")
    )
    return float(max(ranges)) / chosen.intrinsics.fx


def _dated(key: CameraKey, states: Sequence[State]) -> CameraKey:
    """The key with the firmware, where all images name the same."""
    firmware = {state.metadata.software for state in states}
    return replace(key, firmware=firmware.pop() if len(firmware) == 1 else None)


GIVE_K = "register the camera (--registry), or give its K (--fallback-k)"


def _no_k(state: State, evidence: Evidence) -> tuple[str, str]:
    """Why there is no K at all, and what to do about that."""
    metadata = state.metadata
    # A registry knows cameras by their Model: one that names none can only be given its K.
    give_k = GIVE_K if metadata.model is not None else "or give their K (--fallback-k)"
    own_files = f"provide the original files from the camera, {give_k}"
    fisheye = next((w for w in evidence.estimates if not w.pinhole), None)
    if fisheye is not None or evidence.scene.is_fisheye:
        why = "a fisheye lens, which a pinhole K cannot describe"
        return why, "calibrate it as a fisheye; put that file beside the images, or register it (--registry)"
    fault = metadata.fault("EXIF FocalLength")
    if fault is not None:
        return f"EXIF FocalLength is {fault.found}, expected {fault.expected}", own_files
    if evidence.dropped:
        dropped = evidence.dropped[0]
        why, _, what_to_do = f"{dropped.tag}: {dropped.reason}".partition("; ")
        return why, what_to_do or own_files
    if metadata.focal_mm is None and metadata.focal_35mm is not None:
        why = f"EXIF has only a 35 mm equivalent ({metadata.focal_35mm:g} mm), no focal length of this sensor"
        return why, own_files
    if metadata.focal_mm is None:
        missing = "no EXIF FocalLength" if metadata.has_exif else "no EXIF at all"
        return f"{missing} and no calibration tag", own_files
    if state.known.camera is not None:
        why = "the image size is neither the full sensor size scaled nor a 1:1 crop of it"
        return why, "register the camera at this size (--registry)"
    return "the pixel pitch is unknown", f"name the sensor (--sensor-width-mm), {GIVE_K}"
