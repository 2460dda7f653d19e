"""What to use when the images themselves yield no valid K, in the source document's order.

An explicit K; a calibration file that lies with the images; a self-calibration seed, which is not a K until
something refines it; the fleet's registry. Every step leaves a record, whether it was taken or not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import StrEnum
from pathlib import Path

from msgspec import Struct

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import NoDistortion
from calibrary.errors import InputError
from calibrary.evidence.estimate import Source
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.circumstances import circumstances
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.policy import Policy
from calibrary.records import Record, replace
from calibrary.validation import Report, Verdict, validate

__all__ = [
    "Fallback",
    "Sources",
    "Step",
    "StepName",
    "StepOutcome",
    "fits",
    "outranking",
    "read_matrix",
    "seed",
]


MEASURED = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})


class StepName(StrEnum):
    """The steps, in their order."""

    FALLBACK_K = "fallback-k"
    CALIBRATION_FILE = "calibration-file"
    SEED = "self-calibration-seed"
    REGISTRY = "registry"


class StepOutcome(StrEnum):
    """What became of a step."""

    TAKEN = "taken"
    REFUSED = "refused"
    NOT_THERE = "not there"
    KEPT_AS_SEED = "kept as a seed"


class Step(Record):
    """One step of the chain and what became of it.

    Attributes:
        step: which one.
        outcome: whether its K is used.
        source: the file or entry; None where there is none.
        why: of the outcome.
    """

    step: StepName
    outcome: StepOutcome
    source: str | None = None
    why: str


class Sources(Struct, frozen=True, kw_only=True):
    """Where fallbacks may come from.

    Attributes:
        matrix: the explicit K, (file name, Intrinsics without a frame check yet) as a function of the size.
        files: calibrations that lie with the images, with their file's name.
        unreadable: files that look like calibrations, and why they are none.
        knowledge: the registry behind it is the last step.
        rivals: for a frame size, how many cameras of this run are without a K.
    """

    matrix: tuple[str, Callable[[ImageSize], Intrinsics]] | None
    files: tuple[tuple[str, Calibration], ...] = ()
    unreadable: tuple[tuple[str, str], ...] = ()
    knowledge: Knowledge
    rivals: dict[ImageSize, int]


class Fallback(Struct, frozen=True, kw_only=True):
    """The outcome of the chain for one camera.

    Attributes:
        steps: all that was tried, in order.
        calibration: the K that was taken, None when none was.
        report: it against the policy.
        seed: what a solver may start from, never a K; None when a K was taken.
    """

    steps: tuple[Step, ...]
    calibration: Calibration | None = None
    report: Report | None = None
    seed: Calibration | None = None


def read_matrix(path: Path) -> tuple[str, Callable[[ImageSize], Intrinsics]]:
    """Read an explicit K and check that it is one, whatever the frame.

    Raises:
        InputError: no such file, not a .npy, not (3, 3), not finite, or no intrinsic matrix.
    """
    [calibration] = parsers.read(path, format="k_npy", image_size=(1, 1))
    matrix = calibration.intrinsics.matrix

    def for_frame(size: ImageSize) -> Intrinsics:
        return Intrinsics.from_matrix(matrix, size)

    return path.name, for_frame


def seed(key: CameraKey, size: ImageSize, equivalent_px: float | None = None) -> Calibration:
    """Where a self-calibration may start, never a K: 0.8 · max(W, H) and the middle of the frame.

    Args:
        key: of the camera.
        size: (width, height) px of the frame.
        equivalent_px: the 35 mm equivalent in px by the diagonal, which is much nearer where there is one.
    """
    focal = 0.8 * max(size) if equivalent_px is None else equivalent_px
    how = "0.8 × max(W, H)" if equivalent_px is None else "35 mm equivalent by the diagonal"
    return Calibration(
        camera=key,
        intrinsics=Intrinsics(fx=focal, fy=focal, cx=size[0] / 2, cy=size[1] / 2, image_size=size),
        grade=Grade.SEED,
        provenance=Provenance(kind="seed", tag=f"{how}, principal point in the middle"),
    )


def _equivalent_px(camera: Camera, policy: Policy) -> float | None:
    """The 35 mm equivalent, unless the policy keeps the source document's start."""
    estimates = camera.evidence.estimates if policy.independent_sources_settle else ()
    return next((one.intrinsics.fx for one in estimates if one.source is Source.FOCAL_35MM), None)


def fall_back(camera: Camera, policy: Policy, sources: Sources) -> Fallback:
    """Go through the chain for one camera whose images yield no valid K."""
    steps: list[Step] = []
    size = camera.states[0].metadata.size
    for attempt in (_explicit, _from_files):
        calibration, report, step = attempt(camera, size, policy, sources)
        steps.append(step)
        if calibration is not None:
            return Fallback(steps=tuple(steps), calibration=calibration, report=report)
    start = seed(camera.key, size, _equivalent_px(camera, policy))
    steps.append(
        Step(
            step=StepName.SEED,
            outcome=StepOutcome.KEPT_AS_SEED,
            source=start.provenance.tag,
            why="it is not a K, because nothing in this run refines it; a solver may start from it",
        )
    )
    calibration, report, step = _from_registry(camera, policy, sources)
    steps.append(step)
    if calibration is not None:
        return Fallback(steps=tuple(steps), calibration=calibration, report=report)
    return Fallback(steps=tuple(steps), seed=start)


Attempt = tuple[Calibration | None, Report | None, Step]


def _explicit(camera: Camera, size: ImageSize, policy: Policy, sources: Sources) -> Attempt:
    name = StepName.FALLBACK_K
    if sources.matrix is None:
        return None, None, Step(step=name, outcome=StepOutcome.NOT_THERE, why="no --fallback-k given")
    source, for_frame = sources.matrix
    if sources.rivals.get(size, 0) > 1:
        why = f"{sources.rivals[size]} cameras of this size have no K, and one K cannot be of two cameras"
        return None, None, Step(step=name, outcome=StepOutcome.REFUSED, source=source, why=why)
    try:
        intrinsics = for_frame(size)
    except InputError as error:
        return None, None, Step(step=name, outcome=StepOutcome.REFUSED, source=source, why=error.message)
    calibration = Calibration(
        camera=camera.key,
        intrinsics=intrinsics,
        grade=Grade.CALIBRATED,
        provenance=Provenance(
            kind="matrix-file", source=source, assumptions=("the K given is this camera's",)
        ),
    )
    return _judged(camera, calibration, policy, name, source)


def _from_files(camera: Camera, size: ImageSize, policy: Policy, sources: Sources) -> Attempt:
    name = StepName.CALIBRATION_FILE
    fitting = [(source, c) for source, c in sources.files if fits(c, camera.key, size)]
    if not fitting:
        why = "no calibration file for this image size is beside the images"
        if sources.unreadable:
            why += f" ({sources.unreadable[0][0]}: {sources.unreadable[0][1]})"
        elif sources.files:
            sizes = sorted({"{}×{}".format(*c.intrinsics.image_size) for _, c in sources.files})
            why += f" (found for {_first(sizes)})"
        return None, None, Step(step=name, outcome=StepOutcome.NOT_THERE, why=why)
    # A hand-off of an earlier run says so; what images showed then is not a measurement of this camera now.
    measured = [(source, c) for source, c in fitting if c.grade in {Grade.CALIBRATED, Grade.ADJUSTED}]
    if not measured:
        source, calibration = fitting[0]
        why = (
            f"its K is {calibration.grade}, written by an earlier run, and not measured; "
            "provide a measured calibration"
        )
        return None, None, Step(step=name, outcome=StepOutcome.REFUSED, source=source, why=why)
    source, calibration = measured[0]
    different = len({(c.intrinsics, c.distortion) for _, c in measured})
    if different > 1:
        files = _first(dict.fromkeys(source for source, _ in measured))
        why = f"{different} different calibrations fit images of this size: {files}; keep one"
        return None, None, Step(step=name, outcome=StepOutcome.REFUSED, why=why)
    if sources.rivals.get(size, 0) > 1 and calibration.camera.model is None:
        why = f"{sources.rivals[size]} cameras of this size have no K, and the file does not state its camera"
        return None, None, Step(step=name, outcome=StepOutcome.REFUSED, source=source, why=why)
    if calibration.intrinsics.image_size != size:
        calibration = calibration.scaled(size)
    return _judged(camera, replace(calibration, camera=camera.key), policy, name, source)


def _first(names: Iterable[str], most: int = 3) -> str:
    """The first ``most`` of ``names``, and how many more there are."""
    first = list(names)
    more = f" and {len(first) - most} more" if len(first) > most else ""
    return ", ".join(first[:most]) + more


def fits(calibration: Calibration, key: CameraKey, size: ImageSize) -> bool:
    """Whether a file's camera can be this one: same proportions, and no other Model named."""
    width, height = calibration.intrinsics.image_size
    if width * size[1] != height * size[0]:
        return False
    named = calibration.camera.model
    return named is None or key.model is None or named.casefold() == key.model.casefold()


def _from_registry(camera: Camera, policy: Policy, sources: Sources) -> Attempt:
    name = StepName.REGISTRY
    if not sources.knowledge.has_registry:
        return None, None, Step(step=name, outcome=StepOutcome.NOT_THERE, why="no --registry given")
    found = [state.known.calibration for state in camera.states]
    resolved = found[0]
    if len({K.provenance.source if K is not None else None for K in found}) > 1:
        why = (
            "the registry has entries by firmware, and the images of this camera are of several; "
            "put each firmware's images into a separate folder"
        )
        return None, None, Step(step=name, outcome=StepOutcome.REFUSED, why=why)
    known = camera.states[0].known
    if resolved is None or known.resolution is None:
        why = f"the registry has no approved entry for {camera.key}"
        why += "".join(f"; {near.path} does not apply: {near.reason}" for near in known.near[:2])
        return None, None, Step(step=name, outcome=StepOutcome.NOT_THERE, why=why)
    contradicted = camera.calibration is not None and camera.calibration.grade.is_metric
    if contradicted and camera.verdict is Verdict.UNPROVEN and known.resolution.path in (camera.reason or ""):
        why = f"{camera.reason}; one of the two is wrong"
        step = Step(step=name, outcome=StepOutcome.REFUSED, source=resolved.provenance.source, why=why)
        return None, None, step
    calibration, report, step = _judged(camera, resolved, policy, name, resolved.provenance.source)
    if step.outcome is StepOutcome.TAKEN:
        step = replace(step, why=f"{step.why}; {known.resolution.why}")
    return calibration, report, step


def outranking(camera: Camera, policy: Policy, sources: Sources) -> Fallback | None:
    """An approved calibration of the registry instead of a valid K that was only derived and agrees with it.

    The images' K then only confirms it: its principal point and distortion are defaults, and nothing should hand
    those to a solver while measured ones are there. ``source`` keeps the order of the source document.
    """
    own = camera.calibration
    if not policy.independent_sources_settle or own is None or own.grade in MEASURED:
        return None
    if isinstance(own.distortion, NoDistortion):
        return None  # The camera has removed the distortion that the entry describes.
    calibration, report, step = _from_registry(camera, policy, sources)
    known = camera.states[0].known.resolution
    if calibration is None or report is None or known is None or calibration.grade not in MEASURED:
        return None
    if report.verdict is not Verdict.VALID:
        return None
    apart = own.intrinsics.fx / calibration.intrinsics.fx - 1.0
    why = f"it was measured ({calibration.grade}), and {own.provenance.tag} of the images agrees to {abs(apart):.2%}"
    return Fallback(steps=(replace(step, why=f"{why}; {known.why}"),), calibration=calibration, report=report)


def _judged(
    camera: Camera, calibration: Calibration, policy: Policy, name: StepName, source: str | None
) -> Attempt:
    """Hold a fallback against the same policy; one that fails it is refused, not used."""
    around = circumstances(camera.evidence, camera.states[0].known)
    # The images' own K failed and is no measure of what replaces it; their 35 mm equivalent still is.
    prior = {one.tag for one in camera.evidence.estimates if one.source is Source.FOCAL_35MM}
    others = tuple(other for other in around.others if other.name in prior)
    around = replace(
        around,
        others=others,
        weighed=False,
        sensor_assumed=False,
        sensor_given=False,
        zoom=1.0,
        edits=(),
        focal_mm=None,
        spread=None,
    )
    report = validate(calibration, policy, around)
    # What is unproven stands in for a rejected K only: there is nothing to win by it over an unproven one.
    needed = {Verdict.VALID} if camera.verdict is Verdict.UNPROVEN else {Verdict.VALID, Verdict.UNPROVEN}
    why = report.failures[0].message if report.verdict not in needed else None
    if camera.evidence.scene.is_fisheye and isinstance(calibration.distortion, NoDistortion | None):
        why = "a fisheye lens needs its distortion, and this K has none; provide the whole calibration"
    if why is not None:
        return None, None, Step(step=name, outcome=StepOutcome.REFUSED, source=source, why=why)
    step = Step(step=name, outcome=StepOutcome.TAKEN, source=source, why="passes the policy")
    return calibration, report, step
