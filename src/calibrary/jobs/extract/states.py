"""The states of a camera's images in reports."""

from __future__ import annotations

from calibrary.calibration import Grade, Intrinsics
from calibrary.evidence.identity import firmware
from calibrary.evidence.originality import Pixels
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.images.accumulator import Names
from calibrary.records import Record, replace
from calibrary.validation import Verdict

__all__ = ["StateDocument", "states_of"]


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
            verdict=report.verdict if report is not None else Verdict.REJECTED,
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
