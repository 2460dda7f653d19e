"""Validation of a camera: each state of its images by its own sources, and the camera by the worst state.

Images that lack tags of others with the same key may be from another unit, and become a separate camera with
a K of their own grade. If the serial number or the registry proves that they are from one unit, they inherit
its K, and their number is reported.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.catalogue.sensor_widths import listed_width
from calibrary.evidence.context import Scene, SourceEstimate
from calibrary.evidence.identity import firmware
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import Pixels
from calibrary.evidence.weighing import Evidence, disagreement, evidence_of
from calibrary.jobs.extract.cameras import (
    ASSUMED,
    Camera,
    JudgedState,
    Sensor,
    State,
    edits_of,
    group_cameras,
)
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.accumulator import undated
from calibrary.jobs.survey.own import edits_of as own_edits
from calibrary.jobs.survey.own import judged as judged_by
from calibrary.policy import Policy
from calibrary.records import replace
from calibrary.validation import EDITED, SENSOR_STATED, Finding, Report, Severity, group_spread, name_sensor

FAILS = frozenset({Severity.WARNING, Severity.UNPROVEN, Severity.ERROR})

Heard = tuple[State, Evidence]


def judge(
    key: CameraKey,
    states: Sequence[State],
    *,
    policy: Policy,
    sensor: Sensor = ASSUMED,
    one_unit: bool = False,
    root: Path | None = None,
) -> tuple[Camera, ...]:
    """Choose the K of the images with one key and validate it against the policy.

    Args:
        key: camera key.
        states: states of its images, the one with most images first.
        policy: the limits.
        sensor: used if neither the images nor the catalogue state one.
        one_unit: whether the images are known to be from one unit, whatever their metadata.
        root: folder that the images' names are relative to.

    Returns:
        One camera; or several, best K first, if some images lack tags of others and nothing proves one unit.
    """
    heard = [(state, evidence_of(scene_of(state, sensor, policy))) for state in states]
    one_unit = one_unit or _is_one_unit(key, states)
    parts = [heard] if one_unit else _by_grade(heard)
    edited = edits_of(states)

    def report(one: Heard, carrier: Heard, K: Calibration) -> Report:
        """Judge some images by all that is known of them; those that lack tags of others have the K of these."""
        state, evidence = one
        edits = [edited.get(edit, edit) for edit in own_edits(evidence, state.original)]
        entry, name = state.known.resolution or carrier[0].known.resolution, state.names[0]
        image = str(root / name) if root is not None else name
        return judged_by(K, carrier[1], evidence, entry, edits, policy, image)

    first, *others = (_camera(key, part, policy, report, one_unit=one_unit) for part in parts)
    return first, *(_apart_from(first, camera) for camera in others)


def state_of_image(metadata: ImageMetadata, policy: Policy) -> tuple[State, Evidence]:
    """One image as the only one of its camera, and what it states, with what the catalogue knows."""
    [(state, *_)] = group_cameras(undated({metadata: [""]}), Knowledge.load(None)).values()
    return state, evidence_of(scene_of(state, ASSUMED, policy))


def judge_image(metadata: ImageMetadata, name: str, policy: Policy) -> Camera | None:
    """The camera of one image, by the image and the catalogue; None if it states nothing of one."""
    groups = group_cameras(undated({metadata: [name]}), Knowledge.load(None))
    return next((judge(key, group, policy=policy)[0] for key, group in groups.items()), None)


def _apart_from(first: Camera, camera: Camera) -> Camera:
    """Add a finding to a camera of images that lack tags of others with the same key."""
    if camera.report is None or first.calibration is None:
        return camera
    own = camera.evidence.chosen.tag if camera.evidence.chosen is not None else None
    tag = _lacking(first.calibration, own)
    count, images = camera.count, camera.count + first.count
    note = Finding(
        rule="one-unit",
        severity=Severity.NOTE,
        measured=float(count),
        message=f"{count} of {images} images lack {tag}, which the others carry; nothing shows that they are of the "
        "same unit, so they have a K by their own sources",
    )
    return replace(camera, report=replace(camera.report, findings=(*camera.report.findings, note)))


def _lacking(carrier: Calibration, own: str | None) -> str:
    """What images with a K of lower grade lack: the source itself, or a second source that agrees with it."""
    tag = carrier.provenance.tag or carrier.provenance.kind
    return f"a second source that confirms {tag}" if tag == own else tag


def _is_one_unit(key: CameraKey, states: Sequence[State]) -> bool:
    """Whether all images have one serial number or one measured registry entry."""
    if key.serial is not None:
        return True
    answers = [state.known.resolution for state in states]
    found = {(one.layer, one.path) if one is not None else None for one in answers}
    resolution = answers[0]
    return len(found) == 1 and resolution is not None and resolution.calibration.grade.is_measured


def _by_grade(heard: Sequence[Heard]) -> list[list[Heard]]:
    """The states grouped by the grade of K, best first; states without a K last."""
    parts: dict[int, list[Heard]] = {}
    for state, evidence in heard:
        rank = evidence.chosen.rank[0] if evidence.chosen is not None else len(Grade)
        parts.setdefault(rank, []).append((state, evidence))
    return [parts[rank] for rank in sorted(parts)]


def _camera(
    key: CameraKey,
    heard: Sequence[Heard],
    policy: Policy,
    report: Callable[[Heard, Heard, Calibration], Report],
    *,
    one_unit: bool,
) -> Camera:
    """Make one camera. Its K is that of an image, never an average.

    It is taken from the states with the best grade: from an unedited one if possible, and of these from the
    state with most images.
    """
    with_k = [(state, evidence) for state, evidence in heard if evidence.chosen is not None]
    if not with_k:
        state, evidence = heard[0]
        judged = tuple(JudgedState(state=state, evidence=evidence) for state, evidence in heard)
        return Camera(
            key=key,
            judged=judged,
            evidence=evidence,
            calibration=None,
            report=None,
            no_k=_no_k(key, state, evidence),
        )
    best = min(evidence.chosen.rank[0] for _, evidence in with_k if evidence.chosen)
    dated = _dated(key, [state for state, _ in heard])
    own = [
        _own_calibration(dated, *one) if one[1].chosen and one[1].chosen.rank[0] == best else None
        for one in heard
    ]
    # An editor may have moved what its tags still state, so of equal grades the least edited images say most. A mean
    # would be of no lens: two states of one key may be two units.
    carriers = [(one, made) for one, made in zip(heard, own, strict=True) if made is not None]
    reference, calibration = min(carriers, key=lambda carrier: len(carrier[0][0].original.done))
    # Those of a lower grade are of the same unit and lack only its tag: they take this K, judged by their own sources.
    judged = tuple(
        JudgedState(
            state=one[0],
            evidence=one[1],
            calibration=made,
            report=report(one, one, made) if made is not None else report(one, reference, calibration),
            inherits=made is None,
        )
        for one, made in zip(heard, own, strict=True)
    )
    chosen = next(one for one in judged if one.state is reference[0])
    spread = _spread([evidence.chosen for _, evidence in with_k if evidence.chosen], reference[1])
    return Camera(
        key=key,
        judged=judged,
        evidence=reference[1],
        calibration=calibration,
        report=_merged(judged, chosen, policy, spread, one_unit=one_unit),
        spread=spread,
    )


def _own_calibration(key: CameraKey, state: State, evidence: Evidence) -> Calibration | None:
    return evidence.calibration(key, source_name=state.names[0].rsplit("/", 1)[-1])


def _merged(
    judged: Sequence[JudgedState],
    reference: JudgedState,
    policy: Policy,
    spread: float | None,
    *,
    one_unit: bool,
) -> Report:
    """Merge the findings of all states; a finding that does not concern all images states their number."""
    images = sum(one.state.count for one in judged)
    counts, first = Counter[tuple[str, Severity, str]](), dict[tuple[str, Severity, str], Finding]()
    for one in (reference, *(other for other in judged if other is not reference)):
        for finding in one.report.findings if one.report is not None else ():
            if finding.severity in FAILS or one is reference:
                name = (finding.rule, finding.severity, finding.message)
                counts[name] += one.state.count
                first.setdefault(name, finding)
    findings = [
        finding
        if finding.severity not in FAILS or counts[name] == images or finding.rule == EDITED
        else replace(finding, message=f"{counts[name]} of {images} images: {finding.message}")
        for name, finding in first.items()
    ]
    if spread is not None:
        findings.append(group_spread(spread, policy))
    changes = _changes(judged, policy, one_unit=one_unit)
    notes = (*_inherited(judged), *_turned(judged, reference))
    return Report(policy=policy.name, findings=(*findings, *changes, *notes))


def _turned(judged: Sequence[JudgedState], reference: JudgedState) -> Iterator[Finding]:
    """Finding on images with another EXIF Orientation than those of K; K refers to the pixels as stored."""
    stored = reference.state.metadata.orientation or 1
    count = sum(one.state.count for one in judged if (one.state.metadata.orientation or 1) != stored)
    if count:
        images = sum(one.state.count for one in judged)
        yield Finding(
            rule="orientation",
            severity=Severity.NOTE,
            measured=float(count),
            message=f"{count} of {images} images have another EXIF Orientation than the others: K is for the pixels as "
            "they are stored, not as a viewer turns them",
        )


def _inherited(judged: Sequence[JudgedState]) -> Iterator[Finding]:
    """Finding on the number of images that inherit the K of others."""
    images = sum(one.state.count for one in judged)
    lacking = sum(one.state.count for one in judged if one.inherits)
    carrier = next((one.calibration for one in judged if one.calibration is not None), None)
    if not lacking or carrier is None:
        return
    own = {one.evidence.chosen.tag for one in judged if one.inherits and one.evidence.chosen is not None}
    tag = _lacking(carrier, next(iter(own)) if len(own) == 1 else None)
    proof = "their serial number proves" if carrier.camera.serial is not None else "the registry states"
    yield Finding(
        rule="one-unit",
        severity=Severity.NOTE,
        measured=float(lacking),
        message=f"{lacking} of {images} images lack {tag} and take over the K of the other {images - lacking}: "
        f"{proof} that they are of one unit",
    )


def _changes(judged: Sequence[JudgedState], policy: Policy, *, one_unit: bool) -> Iterator[Finding]:
    """Findings on measured calibrations of one camera that differ by more than noise, as after an update or a repair.

    If nothing proves one unit they may be from two units. Either way a single K is right for only some of the
    images.
    """
    groups: list[tuple[Calibration, list[JudgedState]]] = []
    for one in judged:
        if one.calibration is None or not one.calibration.grade.is_measured:
            continue
        alike = next((states for made, states in groups if not _differ(made, one.calibration, policy)), None)
        if alike is None:
            groups.append((one.calibration, [one]))
        else:
            alike.append(one)
    if len(groups) < 2:
        return
    (first, _), (other, _) = groups[:2]
    measured = other.intrinsics.fx / first.intrinsics.fx - 1.0
    what = "the calibration of one unit changed" if one_unit else "the calibration differs"
    more = f"; and {len(groups) - 2} more" if len(groups) > 2 else ""
    yield Finding(
        rule="one-calibration",
        severity=Severity.UNPROVEN if policy.assumed_sensor_is_unproven else Severity.WARNING,
        measured=measured,
        limit=policy.drift_focal,
        message=f"{what} between {_called(*groups[0])} and {_called(*groups[1])}{more}: {measured:+.2%} of fx",
        remedy="put the images of each into a separate folder; 'calibrary diff' compares the two",
    )


def _called(calibration: Calibration, group: Sequence[JudgedState]) -> str:
    """A group in words: firmware, date of calibration and an example image, as far as stated."""
    versions = dict.fromkeys(version for one in group if (version := firmware(one.state.metadata)))
    [first, *_] = group
    images = sum(one.state.count for one in group)
    words = [f"firmware {', '.join(versions)}"] if versions else []
    words += [f"calibration of {calibration.provenance.date}"] if calibration.provenance.date else []
    shown = first.state.names[0] if images == 1 else f"{first.state.names[0]} and {images - 1} more"
    return (
        f"{', '.join(words) or calibration.provenance.tag} (fx = {calibration.intrinsics.fx:.2f} px, {shown})"
    )


def _differ(one: Calibration, other: Calibration, policy: Policy) -> bool:
    a, b = one.intrinsics, other.intrinsics
    moved = max(abs(getattr(a, name) - getattr(b, name)) for name in ("fx", "fy", "cx", "cy"))
    if moved > policy.drift_focal * a.fx:
        return True
    if one.distortion == other.distortion:
        return False
    width, height = a.image_size
    rays = one.unproject(np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]))
    apart = np.abs(replace(other, intrinsics=a).project(rays) - one.project(rays))
    return not bool(np.all(apart <= policy.drift_max_px))


def _spread(estimates: Sequence[SourceEstimate], evidence: Evidence) -> float | None:
    """The largest (max − min) of fx, fy, cx, cy over the states as a fraction of fx; None with one state.

    A state that lost its calibration tags is less precise, not contradictory: it counts only if its focal
    length belongs to another camera.
    """
    chosen = evidence.chosen
    if chosen is None or len(estimates) < 2 or not chosen.is_k:
        return None
    metric = [w for w in estimates if w.is_k]
    equals = [w.intrinsics for w in metric if w.rank[0] == chosen.rank[0] or disagreement(chosen, w)]
    ranges = (
        max(getattr(K, name) for K in equals) - min(getattr(K, name) for K in equals)
        for name in ("fx", "fy", "cx", "cy")
    )
    return float(max(ranges)) / chosen.intrinsics.fx


NO_K = "intrinsics"
"""Rule that a K is stated at all."""
SENSOR_UNKNOWN = "it states a focal length, and nobody the size of its sensor"
GIVE_K = "register the camera (--registry), or give its K (--fallback-k)"


def _dated(key: CameraKey, states: Sequence[State]) -> CameraKey:
    """The key with the firmware, if all images state the same one."""
    versions = {firmware(state.metadata) for state in states}
    return replace(key, firmware=versions.pop() if len(versions) == 1 else None)


def _no_k(key: CameraKey, state: State, evidence: Evidence) -> Finding:
    """Why there is no K, and what to do; that nobody states the sensor, or its part, is no fault of the images."""
    known, metadata, dropped = state.known.camera, state.metadata, evidence.dropped
    if metadata.focal_mm is not None and known is None and not (dropped or evidence.scene.is_fisheye):
        why, what_to_do = SENSOR_UNKNOWN, f"{name_sensor(key)}, {GIVE_K}"
        return Finding(rule=SENSOR_STATED, severity=Severity.UNPROVEN, message=why, remedy=what_to_do)
    why, what_to_do = _why_no_k(state, evidence)
    is_open = bool(dropped) and all(one.is_open for one in dropped)
    if metadata.focal_mm is None and known is None and state.known.siblings:
        why = f"{why}; which of its cameras it is of is {state.known.why}"
        is_open, what_to_do = True, f"state its focal length (--focal-mm), {what_to_do}"
    severity = Severity.UNPROVEN if is_open else Severity.ERROR
    return Finding(rule=NO_K, severity=severity, message=why, remedy=what_to_do)


def _why_no_k(state: State, evidence: Evidence) -> tuple[str, str]:
    metadata = state.metadata
    # A registry identifies cameras by Model, so a K must be given for a camera without one.
    give_k = GIVE_K if metadata.model is not None else "give their K (--fallback-k)"
    is_stripped = not metadata.has_exif or state.original.pixels is not Pixels.ORIGINAL
    own_files = f"provide the original files from the camera, {give_k}" if is_stripped else give_k
    fisheye = next((w for w in evidence.estimates if not w.is_whole), None)
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
    why = "the image size is neither the full sensor size scaled nor a 1:1 crop of it"
    return why, "register the camera at this size (--registry)"


def scene_of(state: State, sensor: Sensor, policy: Policy) -> Scene:
    """Make the scene in which a state's sources are read.

    For a camera that is not in the catalogue the sources are weighed against each other if the policy permits it, with
    or without an entry of the registry: a tag that is not believed in one run is believed in none. Only then are the
    sensor databases consulted.
    """
    sides, camera = sensor.sides(state.metadata), state.known.camera
    knows = camera is not None and camera.gives_k
    weighs = policy.independent_sources_settle and not knows
    return Scene(
        metadata=state.metadata,
        known=camera,
        siblings=state.known.siblings,
        given_sensor_mm=sides if sensor.given else None,
        # For a known camera the default sensor size would be wrong.
        assumed_sensor_mm=sides
        if not sensor.given and not knows and state.known.calibration is None and may_be(sides, state, policy)
        else None,
        weighs=weighs,
        fills=policy.independent_sources_settle,
        listed=listed_width(camera, state.metadata.make, state.metadata.model) if weighs else None,
    )


def may_be(sides: tuple[float, float], state: State, policy: Policy) -> bool:
    """Whether a sensor that nobody states may be this camera's: its pixels are square, and the lens is a usual one."""
    if not policy.assumed_sensor_is_unproven or state.metadata.focal_mm is None:
        return True
    (W, H), (low, high) = state.metadata.size, policy.focal_over_width
    is_square = abs(sides[0] / W / (sides[1] / H) - 1.0) <= (policy.focal_symmetry_proven or 1.0)
    return is_square and low <= state.metadata.focal_mm / sides[0] <= high
