"""The images of a camera by what can change K or its meaning, as reports list them."""

from __future__ import annotations

from calibrary.calibration import Grade, Intrinsics
from calibrary.evidence.edits import edits
from calibrary.evidence.identity import firmware
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.images.accumulator import Names
from calibrary.records import Record, replace
from calibrary.validation import Verdict

__all__ = ["StateDocument", "states_of"]


class StateDocument(Record):
    """Images of a camera that are alike in all that can change K or its meaning.

    Attributes:
        verdict: of the K that holds for them.
        why: the reason, where it is not valid.
        grade: of the K that their own sources give; None where there is none.
        intrinsics: that K.
        inherits: whether they lack what other images carry and take over the camera's K.
        sources: the tags that state a K.
        edits: what an editor did to the pixels.
        firmware: of the camera; None where it is not stated.
        images: path of each image below the folder, or of the first of very many.
        more_images: how many more there are than are listed.
    """

    verdict: Verdict
    why: str | None
    grade: Grade | None
    intrinsics: Intrinsics | None
    inherits: bool
    sources: tuple[str, ...]
    edits: tuple[str, ...]
    firmware: str | None
    images: tuple[str, ...]
    more_images: int = 0

    @property
    def count(self) -> int:
        """How many images there are."""
        return len(self.images) + self.more_images


def states_of(camera: Camera) -> tuple[StateDocument, ...]:
    """A camera's states; those that would be reported alike are one."""
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
            edits=edits(one.state.metadata),
            firmware=firmware(one.state.metadata),
            images=(),
        )
        found.setdefault(document, []).append(one.state.images)
    return tuple(
        replace(document, images=names.listed, more_images=names.count - len(names.listed))
        for document, parts in found.items()
        for names in [Names.joined(parts)]
    )
