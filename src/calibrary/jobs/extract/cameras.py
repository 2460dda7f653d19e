"""Cameras of a run: their images grouped by state, the verdicts, and the states in reports."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics
from calibrary.errors import RegistryError
from calibrary.evidence.context import Dropped
from calibrary.evidence.identity import camera_key, firmware
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import (
    ORIGINAL,
    Originality,
    Pixels,
    no_frame,
    not_described,
    originality,
    usual_of,
)
from calibrary.evidence.weighing import Evidence
from calibrary.jobs.extract.knowledge import Knowledge, Known
from calibrary.jobs.images.accumulator import ByDay, Flight, Names
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.images.observation import Seen, names_a_camera, path_order
from calibrary.jobs.survey import Claim, Survey, of_entry, of_images
from calibrary.policy import Policy
from calibrary.records import Record, replace
from calibrary.validation import Finding, Report, Severity, Verdict

DEFAULT_SENSOR_MM = (13.2, 8.8)
"""The nominal 1-inch sensor, the default of the source document."""


class Sensor(Struct, frozen=True, kw_only=True):
    """Sensor size used when neither the image nor the catalogue states one.

    Attributes:
        size_mm: (width, height); a side is None if only the other was stated.
        given: whether the user stated it; otherwise it is the default, which is an assumption.
    """

    size_mm: tuple[float | None, float | None]
    given: bool

    def sides(self, metadata: ImageMetadata) -> tuple[float, float]:
        """Both sides in mm; a missing one follows from square pixels."""
        width, height = self.size_mm
        w_px, h_px = metadata.size
        if width is not None:
            return width, height if height is not None else width * h_px / w_px
        height = height if height is not None else DEFAULT_SENSOR_MM[1]
        return height * w_px / h_px, height


ASSUMED: Final = Sensor(size_mm=DEFAULT_SENSOR_MM, given=False)


class State(Struct, frozen=True, kw_only=True):
    """One camera state: the images with equal metadata.

    Equal metadata means equal in everything that can affect K: sources, edits, capture mode, firmware, size.

    Attributes:
        metadata: of each image.
        images: their names.
        known: what the registry and the catalogue know of the camera.
        original: whether the pixels are as the camera wrote them.
    """

    metadata: ImageMetadata
    images: Names
    known: Known
    original: Originality = ORIGINAL

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its images; only the first if there are very many."""
        return self.images.listed

    @property
    def count(self) -> int:
        """Number of images."""
        return self.images.count


class JudgedState(Struct, frozen=True, kw_only=True):
    """One state and the verdict on it.

    Attributes:
        state: the images.
        evidence: from their metadata.
        calibration: K from their own sources; None if they have none or inherit the camera's.
        report: validation of the K that applies to them; None if there is none.
        inherits: whether they lack tags of the other images and inherit the camera's K.
    """

    state: State
    evidence: Evidence
    calibration: Calibration | None = None
    report: Report | None = None
    inherits: bool = False


class Camera(Struct, frozen=True, kw_only=True):
    """One camera of the run.

    Attributes:
        key: camera key.
        judged: its states, the one with most images first.
        evidence: of the state that gives the camera's K.
        calibration: the K to use, None if there is none.
        report: the most severe findings of all states, with counts; None without a K.
        spread: spread of K over the states, as a fraction of fx; None with one state.
        no_k: why there is no K; None if there is one.
    """

    key: CameraKey
    judged: tuple[JudgedState, ...]
    evidence: Evidence
    calibration: Calibration | None
    report: Report | None
    spread: float | None = None
    no_k: Finding | None = None

    @property
    def states(self) -> tuple[State, ...]:
        """Its states, without the verdicts."""
        return tuple(one.state for one in self.judged)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its images, state by state; only the first if there are very many."""
        return tuple(name for one in self.judged for name in one.state.names)

    @property
    def count(self) -> int:
        """Number of images."""
        return sum(one.state.count for one in self.judged)

    @property
    def dropped(self) -> tuple[tuple[Dropped, int], ...]:
        """Sources that are not credible, with the number of images that contain them."""
        found: Counter[Dropped] = Counter()
        for one in self.judged:
            found.update(dict.fromkeys(one.evidence.dropped, one.state.count))
        return tuple(found.items())

    def doubt(self, own: Calibration) -> str | None:
        """Why a K that was measured elsewhere may not be of these images: a program changed them; None if none did."""
        changed = not_described(own, self.states[0].metadata.size, [one.original for one in self.states])
        done = {f"the image was {edit}" for one in changed for edit in one.done}
        return next((told for edit, told in edits_of(self.states).items() if edit in done), None)

    def survey(self, policy: Policy, *claims: Claim) -> Survey:
        """All that states a K for its images: their tags, the catalogue, the registry's entry, and more claims."""
        known = self.states[0].known.resolution
        entry = (of_entry(known, policy),) if known is not None else ()
        stated = (*of_images(self.evidence, self.key, policy), *entry, *claims)
        return Survey(self.evidence.scene.metadata, stated, policy)

    @property
    def verdict(self) -> Verdict:
        """Verdict of the report; without a K unproven if nothing is wrong with the images, else rejected."""
        if self.report is not None:
            return self.report.verdict
        is_wrong = self.no_k is None or self.no_k.severity is Severity.ERROR
        return Verdict.REJECTED if is_wrong else Verdict.UNPROVEN

    @property
    def has_k(self) -> bool:
        """Whether its images give a K, be it unproven."""
        return self.calibration is not None and self.verdict is not Verdict.REJECTED

    @property
    def _grave(self) -> Finding | None:
        """What prevents a valid K; None for a valid one."""
        return self.no_k if self.report is None else next(iter(self.report.failures), None)

    @property
    def reason(self) -> str | None:
        """Reason why the K is not valid, in one line; None for a valid K."""
        return self._grave.message if self._grave is not None else None

    @property
    def remedy(self) -> str | None:
        """What to do about it; None for a valid K."""
        if self.report is not None:
            return self.report.remedy
        return self.no_k.remedy if self.no_k is not None else None


def edits_of(states: Sequence[State]) -> dict[str, str]:
    """What was done to images after the camera wrote them, each as a sentence, and with the number of images."""
    edited, first_of = Counter[str](), dict[str, str]()
    for state in states:
        edited.update(dict.fromkeys(state.original.done, state.count))
        first_of = dict.fromkeys(state.original.done, state.names[0]) | first_of
    images = sum(state.count for state in states)
    return {
        f"the image was {edit}": f"{_of(count, images)} {edit}"
        + (f"; the first is {first_of[edit]}" if count < images else "")
        for edit, count in edited.items()
    }


def _of(count: int, images: int) -> str:
    if images == 1:
        return "the image was"
    were = "was" if count == 1 else "were"
    return f"all {images} images were" if count == images else f"{count} of {images} images {were}"


def group_cameras(
    states: Mapping[ImageMetadata, ByDay],
    knowledge: Knowledge,
    refused: dict[ImageMetadata, RegistryError] | None = None,
) -> dict[CameraKey, tuple[State, ...]]:
    """Group the camera states by camera, the state with most images first.

    Args:
        states: images by metadata and date.
        knowledge: what is known of cameras.
        refused: takes the states for which the registry refuses an answer.

    Raises:
        RegistryError: it refuses one, and nothing takes that.
    """
    cameras: dict[CameraKey, list[State]] = {}
    usual = usual_of({one: sum(names.count for names in days.values()) for one, days in states.items()})
    for metadata, days in states.items():
        try:
            answers = [*knowledge.by_day(metadata, days)]
        except RegistryError as error:
            if refused is None:
                raise
            refused[metadata] = error
            continue
        for known, own in answers:
            inferred = known.camera.sub_camera if known.camera is not None else None
            key = camera_key(metadata, inferred)
            original = originality(metadata, known.camera, usual.get(metadata))
            state = State(metadata=metadata, images=own, known=known, original=original)
            cameras.setdefault(key, []).append(state)
    groups = {key: tuple(sorted(group, key=_commonest_first)) for key, group in cameras.items()}
    return dict(sorted(groups.items(), key=lambda item: (str(item[0]), path_order(item[1][0].names[0]))))


def _commonest_first(state: State) -> tuple[int, str]:
    return -state.count, path_order(state.names[0])


class Rows(Struct, frozen=True):
    """Images from which no camera is identified, with the reasons.

    Attributes:
        listed: all images, or only the first if there are very many.
        count: number of images.
    """

    listed: tuple[SkippedFile, ...] = ()
    count: int = 0


class SortedImages(Struct, frozen=True, kw_only=True):
    """The images of a run by category.

    Attributes:
        states: images to evaluate, by metadata and date; the state of the first image first.
        unread: images that cannot be read or contradict themselves.
        pictures: pictures not taken by a camera.
    """

    states: Mapping[ImageMetadata, ByDay]
    unread: Rows
    pictures: Rows


def sort_images(flight: Flight) -> SortedImages:
    """Separate the images that are not evidence of a camera: panoramas, EXIF of another image size, and pictures."""
    whys = {seen: why for seen in flight.seen if (why := no_frame(seen.metadata)) is not None}
    unread = [
        SkippedFile(name=name, reason=why) for seen, why in whys.items() for name in flight.seen[seen].listed
    ]
    left = {seen: names for seen, names in flight.seen.items() if seen not in whys}
    pictures = _pictures(left)
    shown = [
        SkippedFile(name=name, reason=why) for seen, why in pictures.items() for name in left[seen].listed
    ]
    judged = {seen: names for seen, names in left.items() if seen not in pictures}
    return SortedImages(
        states=replace(flight, seen=judged).by_day,
        unread=_rows([*flight.unread, *unread], flight.unread_count + _count(flight, whys)),
        pictures=_rows(shown, _count(flight, pictures)),
    )


def without_refused(images: SortedImages, refused: Mapping[ImageMetadata, RegistryError]) -> SortedImages:
    """Put the images for which the registry refuses an answer among those that no camera is identified from."""
    names = {metadata: Names.joined([*images.states[metadata].values()]) for metadata in refused}
    rows = [
        SkippedFile(name=one, reason=str(refused[key])) for key, some in names.items() for one in some.listed
    ]
    count = images.unread.count + sum(some.count for some in names.values())
    return replace(images, unread=_rows([*images.unread.listed, *rows], count))


def _pictures(seen: Mapping[Seen, Names]) -> dict[Seen, str]:
    """Pictures without camera metadata and with an image size that no camera of the flight has, with the reason.

    An image of the flight without metadata has the size of the others and is kept. JPEGs that are at least a
    quarter of the size of the others, or the majority, are kept as well: they are a flight that was resized
    and lost its metadata, with one original left. If no image names a camera, nothing is removed.
    """
    named = [one for one in seen if names_a_camera(one.metadata)]
    sizes = {one.metadata.size for one in named}
    if not sizes:
        return {}
    small = min(width * height for width, height in sizes) / 4
    sizes |= {(height, width) for width, height in sizes}
    strays = [one for one in seen if not names_a_camera(one.metadata) and one.metadata.size not in sizes]
    others = sum(seen[one].count for one in strays if not one.is_export)
    few = others < sum(seen[one].count for one in named)
    found: dict[Seen, str] = {}
    for one in strays:
        width, height = one.metadata.size
        if one.is_export or (few and width * height < small):
            found[one] = (
                f"it names no camera, and no camera here has images of {width}×{height}: a preview, or a map"
            )
    return found


def _count(flight: Flight, some: Mapping[Seen, str]) -> int:
    return sum(flight.seen[seen].count for seen in some)


def _rows(rows: list[SkippedFile], count: int) -> Rows:
    return Rows(tuple(sorted(rows, key=lambda row: (path_order(row.name), row.reason))), count)


class StateDocument(Record):
    """Images of a camera that are equal in everything that can affect K.

    Attributes:
        verdict: on the K that applies to them.
        why: reason if it is not valid.
        grade: of the K from their own sources; None if there is none.
        intrinsics: that K.
        inherits: whether they lack tags of the other images and inherit the camera's K.
        sources: the tags that state a K.
        pixels: whether they are as the camera wrote them.
        seen: what shows that they are not.
        firmware: of the camera; None if not stated.
        images: path of each image relative to the folder; only the first if there are very many.
        more_images: number of images that are not listed.
    """

    verdict: Verdict
    why: str | None
    grade: Grade | None
    intrinsics: Intrinsics | None
    inherits: bool
    sources: tuple[str, ...]
    pixels: Pixels
    seen: tuple[str, ...]
    firmware: str | None
    images: tuple[str, ...]
    more_images: int = 0

    @property
    def count(self) -> int:
        """Number of images."""
        return len(self.images) + self.more_images


def states_of(camera: Camera) -> tuple[StateDocument, ...]:
    """The states of a camera; states with equal reports are merged."""
    found: dict[StateDocument, list[Names]] = {}
    for one in camera.judged:
        chosen, report = one.evidence.chosen, one.report
        document = StateDocument(
            verdict=report.verdict if report is not None else camera.verdict,
            why=report.failures[0].message if report is not None and report.failures else None,
            grade=chosen.grade if chosen is not None else None,
            intrinsics=chosen.intrinsics if chosen is not None else None,
            inherits=one.inherits,
            sources=tuple(estimate.tag for estimate in one.evidence.estimates),
            pixels=one.state.original.pixels,
            seen=one.state.original.seen,
            firmware=firmware(one.state.metadata),
            images=(),
        )
        found.setdefault(document, []).append(one.state.images)
    return tuple(
        replace(document, images=names.listed, more_images=names.count - len(names.listed))
        for document, parts in found.items()
        for names in [Names.joined(parts)]
    )
