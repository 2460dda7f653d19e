"""Fallbacks if the images give no valid K, in the source document's order.

The steps are: an explicit K; a calibration file in the folder of the images; a self-calibration seed, which
is not a K until it is refined; the fleet's registry. Every step is recorded, whether it is used or not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Final

from msgspec import Struct

from calibrary.admission import admission
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import NoDistortion
from calibrary.errors import InputError, first_of
from calibrary.evidence.context import Source
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.readings import readings
from calibrary.image_size import is_resized
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.files import choose, is_one_camera
from calibrary.jobs.survey import CATALOGUE, Claim, Survey, Weighed, Who, of_entry, of_file
from calibrary.jobs.survey.limits import foreign, model_of
from calibrary.jobs.survey.words import edited
from calibrary.jobs.use import Allowed, allowed
from calibrary.policy import Policy
from calibrary.records import Record, replace
from calibrary.registry.resolution import Resolution
from calibrary.validation import Report, Verdict

CHOICE: Final = "--fallback-camera N"
"""How a user chooses a camera of the explicit file."""


class StepName(StrEnum):
    """The steps, in order."""

    FALLBACK_K = "fallback-k"
    CALIBRATION_FILE = "calibration-file"
    SEED = "self-calibration-seed"
    REGISTRY = "registry"
    PIXELS = "pixels"


class StepOutcome(StrEnum):
    """Outcome of a step."""

    TAKEN = "taken"
    REFUSED = "refused"
    NOT_THERE = "not there"
    KEPT_AS_SEED = "kept as a seed"


class Step(Record):
    """One fallback step and its outcome.

    Attributes:
        step: name of the step.
        outcome: whether its K is used.
        source: the file or entry; None if there is none.
        why: reason for the outcome.
    """

    step: StepName
    outcome: StepOutcome
    source: str | None = None
    why: str

    @property
    def is_refused(self) -> bool:
        """Whether a K that the user put there, or approved, is not used."""
        given = self.step in {StepName.FALLBACK_K, StepName.CALIBRATION_FILE, StepName.REGISTRY}
        return given and self.outcome is StepOutcome.REFUSED and self.source is not None


class Sources(Struct, frozen=True, kw_only=True):
    """Sources of fallbacks.

    Attributes:
        matrix: the explicit K: its file name, and a function that gives its cameras for an image size.
        files: calibrations in the folders of the images, with their file names.
        knowledge: gives the registry, which is the last step.
        rivals: number of cameras of this run without a K, by image size.
    """

    matrix: tuple[str, Callable[[ImageSize], Sequence[Calibration]]] | None
    files: tuple[tuple[str, Calibration], ...] = ()
    knowledge: Knowledge
    rivals: dict[ImageSize, int]


class Fallback(Struct, frozen=True, kw_only=True):
    """Result of the fallback steps for one camera.

    Attributes:
        steps: all steps that were tried, in order.
        calibration: the K that is used, None if there is none.
        report: validation of that K.
        use: what a solver may do with it.
        seed: initial values for a solver, never a K; None if a K is used.
    """

    steps: tuple[Step, ...]
    calibration: Calibration | None = None
    report: Report | None = None
    use: Allowed | None = None
    seed: Calibration | None = None

    @property
    def taken(self) -> Step | None:
        """The step whose K is used; None if there is none."""
        return next((one for one in reversed(self.steps) if one.outcome is StepOutcome.TAKEN), None)

    @property
    def is_valid(self) -> bool:
        """Whether it gives a K that is valid."""
        return self.report is not None and self.report.verdict is Verdict.VALID

    @property
    def passed_over(self) -> tuple[Step, ...]:
        """Its steps, the last refused for its own finding if it gives a K and another is used."""
        if self.report is None:
            return self.steps
        why = self.report.failures[0].message
        return (*self.steps[:-1], replace(self.steps[-1], outcome=StepOutcome.REFUSED, why=why))


def seed(key: CameraKey, size: ImageSize, known: tuple[float, str] | None = None) -> Calibration:
    """Initial values for a self-calibration, never a K: fx = 0.8 · max(W, H) and the image centre.

    Args:
        key: of the camera.
        size: (width, height) of the image in px.
        known: what is known of fx in px, and by what; used instead, because it is much closer.
    """
    focal, how = known or (0.8 * max(size), "0.8 × max(W, H)")
    return Calibration(
        camera=key,
        intrinsics=Intrinsics(fx=focal, fy=focal, cx=size[0] / 2, cy=size[1] / 2, image_size=size),
        grade=Grade.SEED,
        provenance=Provenance(kind="seed", tag=f"{how}, principal point in the middle"),
    )


def _known_focal(camera: Camera, policy: Policy) -> tuple[float, str] | None:
    """Focal length in px by the catalogue or the 35 mm equivalent; None if the source document requires its own."""
    if not policy.independent_sources_settle:
        return None
    known = camera.survey(policy).known
    if known is not None:
        return known.fx, f"{'registry' if known.claim.who is Who.ENTRY else 'catalogue'} focal length"
    estimates = camera.evidence.estimates
    fx = next((one.intrinsics.fx for one in estimates if one.source is Source.FOCAL_35MM), None)
    return (fx, "35 mm equivalent by the diagonal") if fx is not None else None


def _without(step: StepName, outcome: StepOutcome, why: str, source: str | None = None) -> Fallback:
    return Fallback(steps=(Step(step=step, outcome=outcome, source=source, why=why),))


def fall_back(camera: Camera, policy: Policy, sources: Sources) -> Fallback:
    """Try the fallback steps for a camera without a valid K from its images.

    The first valid K is used, else the first that is unproven: a file that contradicts the approved entry is unproven,
    and must not keep the entry from being asked.
    """
    start, kept = _initial(camera, policy)
    attempts: list[Fallback] = []
    for attempt in (_explicit, _from_files, _from_registry):
        if attempt is _from_registry:
            attempts.append(Fallback(steps=(kept,)))
        attempts.append(attempt(camera, policy, sources))
        if attempts[-1].is_valid:
            break
    with_k = [one for one in attempts if one.calibration is not None]
    used = max(with_k, key=lambda one: one.is_valid) if with_k else None
    steps = tuple(step for one in attempts for step in (one.steps if one is used else one.passed_over))
    return replace(used, steps=steps) if used is not None else Fallback(steps=steps, seed=start)


def _initial(camera: Camera, policy: Policy) -> tuple[Calibration, Step]:
    """Initial values of a solver, which are not a K, and the step that keeps them."""
    start = seed(camera.key, camera.states[0].metadata.size, _known_focal(camera, policy))
    why = "it is not a K, because nothing in this run refines it; a solver may start from it"
    step = Step(step=StepName.SEED, outcome=StepOutcome.KEPT_AS_SEED, source=start.provenance.tag, why=why)
    return start, step


def _explicit(camera: Camera, policy: Policy, sources: Sources) -> Fallback:
    size, name = camera.states[0].metadata.size, StepName.FALLBACK_K
    if sources.matrix is None:
        return _without(name, StepOutcome.NOT_THERE, "no --fallback-k given")
    source, for_frame = sources.matrix
    if sources.rivals.get(size, 0) > 1:
        why = f"{sources.rivals[size]} cameras of this size have no K, and one K cannot be of two cameras"
        return _without(name, StepOutcome.REFUSED, why, source)
    try:
        found = for_frame(size)
    except InputError as error:
        return _without(name, StepOutcome.REFUSED, error.message, source)
    fitting = [one for one in found if fits(one, size)]
    own = [one for one in fitting if foreign(one, camera.key) is None]
    if not own:
        sizes = first_of(sorted({"{}×{}".format(*one.intrinsics.image_size) for one in found}))
        other = foreign(fitting[0], camera.key) if fitting else None
        why = other or f"it is for {sizes}, and these images are {size[0]}×{size[1]}"
        return _without(name, StepOutcome.REFUSED, why, source)
    try:
        chosen = own[0] if is_one_camera(own) else choose(found, None, source=source, how=CHOICE)
    except InputError as error:
        return _without(name, StepOutcome.REFUSED, f"it {error.message}", source)
    calibration = replace(chosen, camera=camera.key)
    return _judged(camera, of_file(source, calibration), policy, name, camera.doubt(calibration))


def _from_files(camera: Camera, policy: Policy, sources: Sources) -> Fallback:
    size, name = camera.states[0].metadata.size, StepName.CALIBRATION_FILE
    sized = [(source, c) for source, c in sources.files if fits(c, size)]
    fitting = [(source, c) for source, c in sized if foreign(c, camera.key) is None]
    if sized and not fitting:
        source, other = sized[0]
        why = foreign(other, camera.key) or ""
        return _without(name, StepOutcome.REFUSED, why, source)
    if not fitting:
        return _without(
            name, StepOutcome.NOT_THERE, "no calibration file for this image size is beside the images"
        )
    # A file that an earlier run wrote for a solver is no new measurement of this camera.
    measured = [(source, c) for source, c in fitting if c.grade.is_measured]
    if not measured:
        source, calibration = fitting[0]
        why = (
            f"its K is {calibration.grade}, and not measured; --fallback-k takes it if it is known to be of these "
            "images"
        )
        return _without(name, StepOutcome.REFUSED, why, source)
    # Of two sizes, what was measured at that of changed images has no rival in what cannot be shown to be of them.
    measured = [(source, c) for source, c in measured if camera.doubt(c) is None] or measured
    source, calibration = measured[0]
    different = len({(c.intrinsics, c.distortion) for _, c in measured})
    if different > 1:
        files = first_of(dict.fromkeys(source for source, _ in measured))
        why = f"{different} different calibrations fit images of this size; keep one"
        return _without(name, StepOutcome.REFUSED, why, files)
    model = model_of(calibration)
    if sources.rivals.get(size, 0) > 1 and (model is None or camera.key.model is None):
        whose = "the file does not state its camera" if model is None else "these images do not state theirs"
        why = f"{sources.rivals[size]} cameras of this size have no K, and {whose}"
        return _without(name, StepOutcome.REFUSED, why, source)
    return _judged(camera, of_file(source, calibration), policy, name, camera.doubt(calibration))


def fits(calibration: Calibration, size: ImageSize) -> bool:
    """Whether a calibration is of images with the sides of these."""
    return is_resized(calibration.intrinsics.image_size, size)


def may_be_part(calibration: Calibration, size: ImageSize) -> bool:
    """Whether images may be a part of a calibration's frame, at its scale or a smaller one."""
    return any(way.factor >= 1.0 for way in readings(calibration.intrinsics, ImageMetadata(size=size)))


def _from_registry(camera: Camera, policy: Policy, sources: Sources) -> Fallback:
    name = StepName.REGISTRY
    if not sources.knowledge.has_registry:
        return _without(name, StepOutcome.NOT_THERE, "no registry is used")
    given = [state.known.calibration for state in camera.states]
    resolved = given[0]
    if len({K.provenance.source if K is not None else None for K in given}) > 1:
        why = (
            "the registry has entries by firmware, and the images of this camera are of several; "
            "put each firmware's images into a separate folder"
        )
        return _without(name, StepOutcome.REFUSED, why)
    known = camera.states[0].known
    if resolved is None or known.resolution is None:
        why = f"the registry has no approved entry for {camera.key}"
        waits = known.proposed
        why += f"; {waits.remark}" if waits is not None else ""
        near = (one for one in known.near[:2] if waits is None or one.path != waits.path)
        why += "".join(f"; {one.path} does not apply: {one.reason}" for one in near)
        return _without(name, StepOutcome.NOT_THERE, why)
    claim, doubt = of_entry(known.resolution, policy), camera.doubt(known.resolution.entry.calibration)
    found = _judged(camera, claim, policy, name, doubt)
    whose = resolved.provenance.source
    [step], K = found.steps, found.calibration
    step = replace(step, source=whose)
    if K is not None:
        step = replace(step, why=f"{step.why}; {_chosen(known.resolution, K)}")
        # Of several registries the source names the one that has the entry.
        K = replace(K, provenance=replace(K.provenance, source=whose))
    return replace(found, steps=(step,), calibration=K)


def outranking(camera: Camera, policy: Policy, sources: Sources) -> Fallback | None:
    """Use an approved calibration of the registry in place of a valid but derived K that agrees with it.

    The derived K has default principal point and distortion, which should not be passed to a solver if
    measured ones are available; it only confirms the registry's. Policy ``source`` keeps the order of the
    source document.
    """
    own = camera.calibration
    if not policy.independent_sources_settle or own is None or own.grade.is_measured:
        return None
    if isinstance(own.distortion, NoDistortion):
        return None  # The camera has removed the distortion that the entry describes.
    found, known = _from_registry(camera, policy, sources), camera.states[0].known.resolution
    calibration = found.calibration
    if not found.is_valid or calibration is None or known is None or not calibration.grade.is_measured:
        return None
    apart = own.intrinsics.fx / calibration.intrinsics.fx - 1.0
    why = f"it was measured ({calibration.grade}), and {own.provenance.tag} of the images agrees to {abs(apart):.2%}"
    why = f"{why}; {_chosen(known, calibration)}"
    return replace(found, steps=(replace(found.steps[0], why=why),))


def _chosen(known: Resolution, used: Calibration) -> str:
    """Why this entry, and how its K became that of these images."""
    own, now = known.entry.calibration.provenance.adaptation, used.provenance.adaptation
    return known.why if now is None or now == own else f"{known.why}; {now}"


def proposed_against(camera: Camera, used: Calibration | None, policy: Policy) -> str | None:
    """What is proposed for the camera in the registry and contradicts the K that is used, in one sentence.

    A nominal K that lies beyond what a measurement states of itself is reported too: it is as far as lenses usually are
    from what is engraved, and the measurement is the better start.
    """
    found = camera.states[0].known.proposed
    if found is None or used is None:
        return None
    K = used.intrinsics
    proposed, survey = of_entry(found, policy), camera.survey(policy)
    stated = next((one for one in survey.placed if one.calibration.intrinsics == K), None)
    own = stated.claim if stated is not None else of_file(used.provenance.tag or used.provenance.kind, used)
    against = Survey(survey.metadata, [own, proposed], policy).weigh(own).against
    may, its = allowed(found.calibration, policy), found.calibration.intrinsics
    off = its.fx / K.fx - 1.0
    if against:
        told = against[0].message
    elif not own.is_measured and may.sigma_focal and abs(off) > 3.0 * may.sigma_focal:
        told = f"it states fx = {its.fx:.1f} px, {off:+.1%}, and is the better start"
    else:
        return None
    return (
        f"{found.remark}; beside {own.name} of these images {told} ({may.use}: {may.why}); 'calibrary registry show "
        f"{found.path}' shows it"
    )


def by_pixels(camera: Camera, fallback: Fallback | None, measured: Calibration, policy: Policy) -> Fallback:
    """The K that the pixels measured in place of none, or as the start if the images' own tags contradict it.

    Tags of an image that was cropped, enlarged or turned since describe another frame, so they contradict nothing.

    Args:
        camera: without a valid K.
        fallback: the steps before.
        measured: K by the pixels.
        policy: the limits.
    """
    own = replace(measured, camera=camera.key)
    claim = of_file(measured.provenance.tag or StepName.PIXELS.value, own)
    edited = any(state.original.done for state in camera.states)
    survey = Survey(camera.evidence.scene.metadata, [claim], policy) if edited else None
    found = _judged(camera, claim, policy, StepName.PIXELS, survey=survey)
    steps = fallback.steps if fallback is not None else ()
    if found.is_valid:
        return replace(found, steps=(*steps, *found.steps))
    [step] = found.passed_over
    if found.taken is not None:
        step = replace(step, outcome=StepOutcome.KEPT_AS_SEED)
    return Fallback(steps=(*steps, step), seed=own)


def _judged(
    camera: Camera,
    claim: Claim,
    policy: Policy,
    name: StepName,
    doubt: str | None = None,
    *,
    survey: Survey | None = None,
) -> Fallback:
    """Weigh a fallback among all that states a K for the images; if it fails, it is not used.

    Args:
        camera: without a valid K.
        claim: the fallback.
        policy: the limits.
        name: of the step.
        doubt: what was done to the images since, so that a K that was measured on others may not be of them.
        survey: of the images, with the claim; None for all that states a K for them.
    """
    if survey is None:
        survey = camera.survey(policy, *(() if claim.who is Who.ENTRY else (claim,)))
        claim = next(one for one in survey.claims if one.who is claim.who)
    weighed = survey.weigh(claim)
    if not weighed.ways:
        return _without(name, StepOutcome.REFUSED, weighed.use.why, claim.name)
    calibration = replace(weighed.ways[0].calibration, camera=camera.key)
    doubted = (edited(doubt, policy),) if doubt is not None else ()
    report = Report(policy=policy.name, findings=(*weighed.findings, *doubted))
    why = _why_refused(camera, weighed, report)
    if why is not None and why == doubt:
        why = "nothing shows that what it describes is left in images that a program changed"
    if camera.evidence.scene.is_fisheye and isinstance(calibration.distortion, NoDistortion | None):
        why = "a fisheye lens needs its distortion, and this K has none; provide the whole calibration"
    if why is not None:
        return _without(name, StepOutcome.REFUSED, why, claim.name)
    said = "; ".join(("passes the policy", *weighed.remarks))
    step = Step(step=name, outcome=StepOutcome.TAKEN, source=claim.name, why=said)
    return Fallback(steps=(step,), calibration=calibration, report=report, use=weighed.use)


def _why_refused(camera: Camera, weighed: Weighed, report: Report) -> str | None:
    """Why a fallback is not used; None if it is.

    An unproven one can replace a rejected K, but is no better than an unproven one, and none if it was computed or
    what is known of the camera shows it wrong.
    """
    is_known_wrong = weighed.claim.who is Who.FILE and any(
        CATALOGUE in one.one.claim.rests_on for one in weighed.believed
    )
    needed = {Verdict.VALID}
    if not camera.has_k and weighed.computed is None and not is_known_wrong:
        needed.add(Verdict.UNPROVEN)
    if report.verdict in needed:
        return None
    unlikely = admission(weighed.ways[0].calibration)
    return unlikely.message if unlikely is not None else report.failures[0].message
