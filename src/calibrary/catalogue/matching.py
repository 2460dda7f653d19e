"""Identification of the known camera that took an image, from the image's metadata and without guessing.

Make and Model must be equal except for letter case and blanks; a part of a name is not a match. If several
cameras share a Model, a tag that names the sub-camera decides. Without such a tag (old firmware, or lost XMP)
the image size and the focal length decide, provided they support one camera and exclude the others.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum, StrEnum
from typing import Final

from msgspec import Struct

from calibrary.camera_key import CameraKey
from calibrary.errors import InputError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.image_size import ImageSize, same_aspect
from calibrary.known_camera import SUB_CAMERAS, KnownCamera, normalise_sub_camera
from calibrary.records import replace

__all__ = ["Basis", "Catalogue", "Identified", "Match", "MatchOutcome", "identified", "match_image"]

FOCAL_TOLERANCE: Final = 0.05
LARGEST_BINNING: Final = 8
SMALLEST_CROP: Final = 0.5
"""Camera modes keep at least this fraction of the rows or columns; a smaller part was cropped by a user."""


class MatchOutcome(StrEnum):
    """Outcome of a search; the value is the word shown to the user."""

    FOUND = "found"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"


class Basis(StrEnum):
    """The clue that distinguished the camera from others with the same Model."""

    MODEL = "the Model, which is one camera"
    TAG = "the sub-camera tag"
    LENS = "the lens"
    FOCAL = "the focal length"
    SIZE = "the size of the frame"


class Match(Struct, frozen=True, kw_only=True):
    """Result of a search.

    Attributes:
        outcome: whether one camera, several or none remain.
        reason: explanation in one line.
        camera: the camera, if exactly one remains.
        basis: the clue that distinguished it from others.
        candidates: the remaining cameras: the one that was found, or all that are possible.
        siblings: all other entries of this make and Model.
    """

    outcome: MatchOutcome
    reason: str
    camera: KnownCamera | None = None
    basis: tuple[Basis, ...] = ()
    candidates: tuple[KnownCamera, ...] = ()
    siblings: tuple[KnownCamera, ...] = ()


class _Clues(Struct, frozen=True, kw_only=True):
    """Metadata used for the search besides make, Model and sub-camera."""

    size: ImageSize | None
    focal_mm: float | None
    focal_35mm: float | None
    lens: str | None


class _Says(Enum):
    """Whether a clue supports or excludes a candidate."""

    NO = "against it"
    NOTHING = "nothing"
    PERHAPS = "for it, if no other camera is left"
    YES = "for it"


class Catalogue:
    """Known cameras in the order of their files, indexed by make and Model."""

    __slots__ = ("_by_name", "cameras")

    def __init__(self, cameras: Iterable[KnownCamera]) -> None:
        """Index the cameras.

        Raises:
            InputError: two entries describe the same camera.
        """
        self.cameras: Final = tuple(cameras)
        self._by_name: Final = _index(self.cameras)

    def __iter__(self) -> Iterator[KnownCamera]:
        return iter(self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)

    def search(self, text: str) -> list[KnownCamera]:
        """Cameras with every word of ``text`` in their make, Model, title, sub-camera or lens."""
        words = _fold(text).split()
        return [camera for camera in self.cameras if all(word in _described(camera) for word in words)]

    def find(
        self,
        make: str | None,
        model: str | None,
        *,
        sub_camera: str | None = None,
        size: ImageSize | None = None,
        focal_mm: float | None = None,
        focal_35mm: float | None = None,
        lens: str | None = None,
    ) -> Match:
        """Find the camera that took an image.

        Args:
            make: EXIF Make.
            model: EXIF Model.
            sub_camera: sub-camera named by a tag, in any spelling; a word outside the vocabulary is ignored.
            size: (width, height) in px of the image as decoded.
            focal_mm: EXIF FocalLength.
            focal_35mm: EXIF FocalLengthIn35mmFilm, used if FocalLength is missing.
            lens: EXIF LensModel.
        """
        if not make or not model:
            return Match(outcome=MatchOutcome.UNKNOWN, reason="the image names no make and Model")
        entries = self._by_name.get((_fold(make), _fold(model)), ())
        if not entries:
            return Match(
                outcome=MatchOutcome.UNKNOWN, reason="the catalogue has no camera of this make and Model"
            )
        tag = normalise_sub_camera(sub_camera) if sub_camera else None
        clues = _Clues(size=size, focal_mm=focal_mm, focal_35mm=focal_35mm, lens=lens)
        match = _decide(entries, tag if tag in SUB_CAMERAS else None, clues)
        return replace(match, siblings=tuple(camera for camera in entries if camera is not match.camera))


def match_image(catalogue: Catalogue, metadata: ImageMetadata) -> Match:
    """Find the camera of an image in the catalogue from all of its metadata."""
    return catalogue.find(
        metadata.make,
        metadata.model,
        sub_camera=metadata.sub_camera,
        size=metadata.size,
        focal_mm=metadata.focal_mm,
        focal_35mm=metadata.focal_35mm,
        lens=metadata.lens,
    )


def _decide(entries: Sequence[KnownCamera], tag: str | None, clues: _Clues) -> Match:
    left = _answering(entries, tag) if tag is not None else entries
    if not left:
        known = ", ".join(dict.fromkeys(camera.sub_camera or camera.title for camera in entries))
        return Match(
            outcome=MatchOutcome.UNKNOWN, reason=f"tagged as {tag}; of this Model the catalogue knows {known}"
        )
    only = left[0]
    named = tag is not None and only.answers(tag)
    basis = (Basis.TAG,) if named and only.sub_camera is not None else (Basis.MODEL,)
    if len(left) == 1 and only.lens is None and (only.sub_camera is None or named):
        return _match_of(only, basis)
    narrowed = _by_clues(left, clues)
    if narrowed.camera is not None and len(left) < len(entries):
        return _match_of(narrowed.camera, (Basis.TAG, *narrowed.basis))
    return narrowed


def _answering(entries: Sequence[KnownCamera], tag: str) -> Sequence[KnownCamera]:
    """The entries that a tag names, otherwise those that it does not exclude."""
    exact = [camera for camera in entries if camera.answers(tag)]
    return exact or [camera for camera in entries if camera.may_answer(tag)]


def _by_clues(entries: Sequence[KnownCamera], clues: _Clues) -> Match:
    """Match the one entry that no clue excludes and at least one clue supports."""
    judged = [(camera, _judge(camera, clues)) for camera in entries]
    left = [(camera, said) for camera, said in judged if _Says.NO not in said.values()]
    if not left:
        known = "; ".join(camera.title for camera in entries)
        reason = f"frame or focal length fit none of: {known}"
        return _other_lens(entries, clues) or Match(outcome=MatchOutcome.UNKNOWN, reason=reason)
    spoken_for = left
    for basis in (Basis.LENS, Basis.FOCAL, Basis.SIZE):
        said_yes = [camera for camera, said in left if said[basis] is _Says.YES]
        if said_yes:
            spoken_for = [(camera, said) for camera, said in spoken_for if camera in said_yes]
    if len(spoken_for) == 1:
        camera, said = spoken_for[0]
        if basis_found := tuple(basis for basis, says in said.items() if says in {_Says.YES, _Says.PERHAPS}):
            return _match_of(camera, basis_found)
    candidates = tuple(camera for camera, _ in spoken_for or left)
    titles = "; ".join(camera.title for camera in candidates)
    reason = (
        f"not decided by any tag: {titles}"
        if len(candidates) > 1
        else f"nothing says that it is the {titles}"
    )
    return Match(outcome=MatchOutcome.AMBIGUOUS, reason=reason, candidates=candidates)


def _match_of(camera: KnownCamera, basis: tuple[Basis, ...]) -> Match:
    reason = f"{camera.title}, by {' and '.join(basis)}"
    return Match(outcome=MatchOutcome.FOUND, reason=reason, camera=camera, basis=basis, candidates=(camera,))


def _other_lens(entries: Sequence[KnownCamera], clues: _Clues) -> Match | None:
    """Match the body alone if its lens is not listed: the pixel pitch is known, the expected fx is not."""
    first = entries[0]
    if any(camera.lens is None or _frame(camera) != _frame(first) for camera in entries):
        return None
    if _size_says(first.native_size, clues.size) is _Says.NO:
        return None
    stated = dict(first.sources)
    return _match_of(
        replace(
            first,
            title=f"{first.title.partition(',')[0]}, another lens",
            lens=None,
            focal_mm=None,
            focal_35mm=None,
            fx_over_w=None,
            spread=None,
            conflicts=(),
            sources=tuple((name, stated[name]) for name in ("native_size", "pitch_um") if name in stated),
        ),
        (Basis.MODEL,),
    )


def _frame(camera: KnownCamera) -> tuple[ImageSize | None, float | None, str | None]:
    return camera.native_size, camera.pitch_um, camera.sub_camera


def _judge(camera: KnownCamera, clues: _Clues) -> Mapping[Basis, _Says]:
    return {
        Basis.LENS: _lens_says(camera, clues.lens),
        Basis.FOCAL: _focal_says(camera, clues),
        Basis.SIZE: _size_says(camera.native_size, clues.size),
    }


def _lens_says(camera: KnownCamera, lens: str | None) -> _Says:
    if camera.lens is None or not lens:
        return _Says.NOTHING
    return _Says.YES if _squeeze(camera.lens) == _squeeze(lens) else _Says.NOTHING


def _focal_says(camera: KnownCamera, clues: _Clues) -> _Says:
    """Whether the focal length is within 5 % of the nominal one, or of a zoom lens's range."""
    focal_mm = clues.focal_mm if clues.focal_mm is not None else _focal_in(clues.lens)
    if focal_mm is not None and camera.focal_mm is not None and camera.exif_focal_trusted:
        shortest, longest = camera.zoom_mm or (camera.focal_mm, camera.focal_mm)
        fits = shortest * (1 - FOCAL_TOLERANCE) <= focal_mm <= longest * (1 + FOCAL_TOLERANCE)
        return _Says.YES if fits else _Says.NO
    if focal_mm is None and clues.focal_35mm is not None and camera.focal_35mm is not None:
        # The 35 mm equivalent is a whole number, truncated as often as rounded.
        apart = abs(clues.focal_35mm - camera.focal_35mm)
        return _Says.YES if apart <= max(1.0, FOCAL_TOLERANCE * camera.focal_35mm) else _Says.NO
    return _Says.NOTHING


def _focal_in(lens: str | None) -> float | None:
    """The focal length in the name of a prime lens, in mm."""
    stated = re.findall(r"(?<![\d.-])(\d{1,4}(?:\.\d{1,2})?) ?mm", lens[:200]) if lens else []
    return float(stated[0]) if len(stated) == 1 else None


def _size_says(native: ImageSize | None, size: ImageSize | None) -> _Says:
    """Whether a camera can write this image size: full frame, scaled by a whole number, or cropped 1:1 on one side.

    A crop from one camera may be a resized image from another (640×480 from 640×512, or from 4:3). The same
    aspect ratio at another scale may be a resized image from any camera; another aspect ratio excludes the
    camera.
    """
    if native is None or size is None or min(size) <= 0:
        return _Says.NOTHING
    if same_aspect(native, size):
        return _Says.YES if _is_multiple(native, size) or _is_multiple(size, native) else _Says.NOTHING
    cropped_rows = size[0] == native[0] and native[1] * SMALLEST_CROP <= size[1] <= native[1]
    cropped_columns = size[1] == native[1] and native[0] * SMALLEST_CROP <= size[0] <= native[0]
    return _Says.PERHAPS if cropped_rows or cropped_columns else _Says.NO


def _is_multiple(large: ImageSize, small: ImageSize) -> bool:
    factor = round(large[0] / small[0])
    near = all(abs(a - factor * b) <= factor for a, b in zip(large, small, strict=True))
    return near and 1 <= factor <= LARGEST_BINNING


def _index(cameras: Iterable[KnownCamera]) -> Mapping[tuple[str, str], tuple[KnownCamera, ...]]:
    by_name: dict[tuple[str, str], dict[tuple[object, ...], KnownCamera]] = {}
    for camera in cameras:
        identity = (camera.sub_camera, camera.lens, camera.focal_mm)
        for name in dict.fromkeys(
            (_fold(make), _fold(model))
            for make in (camera.make, *camera.other_makes)
            for model in camera.models
        ):
            there = by_name.setdefault(name, {})
            if identity in there:
                raise InputError(
                    f"{there[identity].title} and {camera.title} share Model, sub-camera, lens and focal "
                    "length; expected one entry for one camera"
                )
            there[identity] = camera
    return {name: tuple(entries.values()) for name, entries in by_name.items()}


def _described(camera: KnownCamera) -> str:
    words = (
        camera.make,
        *camera.models,
        camera.title,
        camera.sub_camera or "",
        *camera.bands,
        camera.lens or "",
    )
    return _fold(" ".join(words))


def _fold(text: str) -> str:
    """The text without letter case, blanks and padding; nothing else is removed, because FC6310 is not FC6310R."""
    return " ".join(text.replace("\0", " ").split()).casefold()


def _squeeze(text: str) -> str:
    return _fold(text).replace(" ", "")


class Identified(Struct, frozen=True, kw_only=True):
    """A camera identified from an image.

    Attributes:
        key: with the firmware: it is not used to group images, but an entry may apply to one firmware only.
        camera: its row of the catalogue, None for an unknown camera.
        siblings: the other cameras with the same EXIF Model.
        why: how the row was found, or why there is none.
    """

    key: CameraKey
    camera: KnownCamera | None
    siblings: tuple[KnownCamera, ...]
    why: str


def identified(metadata: ImageMetadata, catalogue: Catalogue) -> Identified:
    """Identify the camera that wrote this metadata."""
    # The readers of tags load NumPy, which a look into the catalogue does without.
    from calibrary.evidence.identity import camera_key, firmware  # noqa: PLC0415  the reason above

    match = match_image(catalogue, metadata)
    inferred = match.camera.sub_camera if match.camera is not None else None
    return Identified(
        key=replace(camera_key(metadata, inferred), firmware=firmware(metadata)),
        camera=match.camera,
        siblings=match.siblings or match.candidates,
        why=match.reason,
    )
