"""Cameras known by name: one YAML file per maker in ``registry/catalogue/``, with a source for every number.

The catalogue describes a camera model (pixel pitch, nominal lens), not the calibration of a unit: it gives a
K to start from and a value to compare others with. If sources disagree, the entry says so; a number that no
source states is left out.

A new camera is an entry of the maker's file:

1.  ``models`` are the spellings of EXIF Model and ``make`` that of EXIF Make, as the camera writes them
    (``calibrary inspect --tags IMAGE`` shows both); letter case and blanks do not matter. If no source states what a
    camera writes, its list is empty: the camera is found by its title, but no image is taken for one of it. A maker
    without a file gets one, named as its make in lower case.
2.  Each number stands with its source, ``{value: 2.4, source: "DJI: data sheet"}``; the word before the colon is a key
    of the file's ``references``. :class:`~calibrary.known_camera.KnownCamera` explains the fields, ``native_size`` and
    ``pitch_um`` are the ones that give a K, ``fx_over_w`` is what a K is compared with. ``sizes`` are stated only if
    they are all: an image of another size is taken for a crop. If sources disagree, say so under ``conflicts`` instead
    of choosing silently.
3.  Several sensors under one Model are several entries, each with its ``sub_camera``; several lenses of one body each
    with its ``lens``. Bodies with the same camera share its entry: their Models stand in one list.
4.  ``calibrary catalogue MODEL`` shows the entry. ``tests/registry/test_catalogue.py`` names what is wrong with it: a
    source without a reference, an image that would not find it, a focal length that does not give its fx.

A camera that writes its calibration in a new way also needs a reader in :mod:`calibrary.evidence` (a module with
``estimates(scene)``, and its row in ``SOURCES`` of ``evidence/weighing.py``) and an image that writes it so in
``tests/imagery/``.

A camera is identified from an image's metadata without guessing. Make and Model must be equal except for letter case
and blanks; a part of a name is not a match. If several cameras share a Model, a tag that names the sub-camera decides.
Without such a tag (old firmware, or lost XMP) the image size and the focal length decide, provided they support one
camera and exclude the others.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from enum import Enum, StrEnum
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Final

from msgspec import Struct

from calibrary.arguments import CameraLike
from calibrary.errors import InputError, ParseError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.image_size import ImageSize, same_aspect
from calibrary.known_camera import (
    SUB_CAMERAS,
    CameraKey,
    KnownCamera,
    Name,
    Text,
    hashed,
    is_serial_hash,
    normalise_sub_camera,
)
from calibrary.records import Json, Meta, Record, from_json, replace, to_json
from calibrary.strictyaml import line_of, load_yaml

__all__ = [
    "Basis",
    "Catalogue",
    "CatalogueListing",
    "Identified",
    "Maker",
    "Match",
    "MatchOutcome",
    "camera_named",
    "identified",
    "load_catalogue",
    "match_image",
    "overlay",
    "search_catalogue",
    "shipped_catalogue",
    "shipped_folder",
    "shipped_with",
]

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
        """Cameras with every word of ``text`` in their make, Model, title, sub-camera or lens.

        Only if no camera has all of them as whole words, parts of words count as well: L3 is the Zenmuse L3 and not
        the L3D of another camera.
        """
        wanted = _words(text)
        whole = [camera for camera in self.cameras if wanted <= _words(_described(camera))] if wanted else []
        parts = _fold(text).split()
        return whole or [
            camera for camera in self.cameras if all(part in _described(camera) for part in parts)
        ]

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

    An enlarged frame may be the full one of a larger sensor. A crop from one camera may be a resized image from
    another (640×480 from 640×512, or from 4:3). The same aspect ratio at another scale may be a resized image from
    any camera; another aspect ratio excludes the camera.
    """
    if native is None or size is None or min(size) <= 0:
        return _Says.NOTHING
    if same_aspect(native, size):
        if _is_multiple(native, size):
            return _Says.YES
        return _Says.PERHAPS if _is_multiple(size, native) else _Says.NOTHING
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
            for model in camera.names
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


def _words(text: str) -> frozenset[str]:
    """The words of a name; a + belongs to its word, other signs part them."""
    return frozenset(re.findall(r"[\w+]+", _fold(text)))


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


LARGEST_FILE: Final = 1 << 22


class Maker(Record, tag_field="schema", tag="calibrary/catalogue-1"):
    """One maker's cameras, as the catalogue file states them.

    Attributes:
        make: EXIF Make; letter case and blanks are ignored.
        references: full source by the short name that a ``source`` begins with.
        cameras: cameras of this make; the make is not repeated in them.

    Raises:
        InputError: a camera has another make.
    """

    make: Name
    references: Mapping[str, Text] = {}
    cameras: Annotated[tuple[KnownCamera, ...], Meta(min_length=1)]

    def __post_init__(self) -> None:
        if any(camera.make != self.make for camera in self.cameras):
            raise InputError(f"a camera is not of {self.make}", place="cameras")

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        cameras: list[Json] = []
        for camera in self.cameras:
            written = to_json(camera)
            del written["make"]
            cameras.append(written)
        return document | {"cameras": cameras}

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        make, cameras = document.get("make"), document.get("cameras")
        if isinstance(cameras, list):
            if any(isinstance(camera, dict) and "make" in camera for camera in cameras):
                raise InputError("is the file's make, not a key of a camera", place="cameras")
            document["cameras"] = [{"make": make, **one} if isinstance(one, dict) else one for one in cameras]
        return document

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
        camera = defs["KnownCamera"]
        del camera["properties"]["make"]
        camera["required"].remove("make")
        return schema


class CatalogueListing(Record, tag_field="schema", tag="calibrary/catalogue-listing-1"):
    """Output of calibrary catalogue --json.

    Attributes:
        cameras: the known cameras of all makers.
    """

    cameras: tuple[KnownCamera, ...]


def load_catalogue(path: Path | None = None) -> Catalogue:
    """Load the shipped catalogue, or one of your own.

    Args:
        path: a YAML file, or a folder of them. None for the shipped one.

    Raises:
        InputError: there is nothing to read, or two entries describe the same camera.
        ParseError: a file is not YAML or violates the schema.
    """
    if path is None:
        return shipped_catalogue()
    sources = sorted(path.glob("*.yaml")) if path.is_dir() else [path]
    if not sources:
        raise InputError("no catalogue here: expected a YAML file, or a folder with some", source=str(path))
    return Catalogue(camera for one in sources for camera in _cameras(_content(one), one.name))


def search_catalogue(text: str) -> list[KnownCamera]:
    """Cameras that :meth:`Catalogue.search` finds in the shipped catalogue."""
    return Catalogue(shipped_with(_words(text))).search(text)


def camera_named(name: str) -> KnownCamera:
    """The one camera of the shipped catalogue with this Model or title, or with one that contains it.

    Raises:
        InputError: no camera matches, or several do.
    """
    found, wanted = search_catalogue(name), name.strip().casefold()
    exact = [
        camera
        for camera in found
        if wanted in {camera.title.casefold(), *(model.casefold() for model in camera.models)}
    ]
    found = exact or found
    if len(found) == 1:
        return found[0]
    titles = "; ".join(camera.title for camera in found[:8]) + (" …" if len(found) > 8 else "")
    like = f"{len(found)} like it ({titles})" if found else "none like it"
    raise InputError(
        f"camera {name!r}: the catalogue has {like}; expected one Model or title of those that 'calibrary catalogue' "
        "lists"
    )


def shipped_with(words: Iterable[str]) -> list[KnownCamera]:
    """The cameras in those shipped files that contain every word, ignoring case; other files are not parsed."""
    wanted = [word.casefold() for word in words]
    return [
        camera
        for name, text in _shipped_files().items()
        if all(word in text.casefold() for word in wanted)
        for camera in _cameras(text.encode(), name)
    ]


def overlay(camera: CameraLike | None) -> Callable[[CameraKey], CameraKey]:
    """Return a function that replaces fields of a camera key by the stated ones, and a serial number by its hash.

    The make is part of that hash, so a number is hashed with the make in the letters that the camera writes.
    """
    names = CameraKey.__struct_fields__
    stated = {name: value for name in names if (value := getattr(camera, name, None)) is not None}

    def key_of(known: CameraKey) -> CameraKey:
        key = camera(known) if callable(camera) else replace(known, **stated)
        if key.make and key.serial and not is_serial_hash(key.serial):
            key = replace(key, make=as_written(key.make))
        return hashed(key)

    return key_of


@cache
def as_written(make: str) -> str:
    """A make in the letters of the catalogue, which are EXIF's; as it is if the catalogue does not know it."""
    names = {name for one in shipped_with(make.split()) for name in (one.make, *one.other_makes)}
    alike = sorted(name for name in names if _fold(name) == _fold(make))
    return make if make in alike or not alike else alike[0]


def shipped_folder() -> Path:
    """The folder of the catalogue's files; importlib.resources would load twenty modules to give the same path."""
    return Path(__file__).parents[1] / "registry" / "catalogue"


@cache
def shipped_catalogue() -> Catalogue:
    """The shipped catalogue, read once per process."""
    return Catalogue(
        [camera for name, text in _shipped_files().items() for camera in _cameras(text.encode(), name)]
    )


@cache
def _shipped_files() -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(shipped_folder().glob("*.yaml"))}


def _content(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=str(path)) from None
    if len(data) > LARGEST_FILE:
        raise ParseError(f"is larger than {LARGEST_FILE >> 20} MiB, expected a catalogue", source=str(path))
    return data


@cache
def _cameras(data: bytes, name: str) -> tuple[KnownCamera, ...]:
    document = load_yaml(data, source=name)
    return from_json(Maker, document, source=name, locate=partial(line_of, data)).cameras
