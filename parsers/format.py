"""Definition of a file format, and how to add one.

A new format needs only its module, ``parsers/formats/<name>.py``, and its test:

1.  The module's docstring describes the format in its own terms, with a link; facts are constants at the top.
2.  ``CONVENTION`` states the format's conventions (unit, origin, y axis, direction, order of the tangential terms).
    :meth:`Convention.intrinsics` and :meth:`Convention.native` do the conversion; a format never adds half a pixel
    itself.
3.  ``sniff(content) -> Sniff | None`` uses the shared views of :class:`~calibrary.parsers.content.Content` and parses
    nothing itself; ``syntaxes`` restricts the files for which it is called. ``MAGIC``: a signature that no other format
    has. ``SHAPE``: keys or columns that another format might share. ``WEAK``: no evidence in the file; used only if no
    other format recognises it.
4.  ``read(data, context) -> list[Calibration]`` takes bytes and opens no files; ``context.companion(name)`` reads a
    file that belongs to it. It returns all cameras in order; with several, ``sub_camera`` is the name of each in the
    file and ``provenance.tag`` its key. ``context.size(found)`` determines the image size, ``context.option(name)``
    what only the user can know (declare it as an :class:`Option`), ``context.provenance(...)`` the provenance: only the
    date, tool, operator and focus that the file itself states, each declared in ``Format.states``;
    ``context.calibration(K, lens, ...)`` makes the calibration with it. Parse numbers with
    ``parsers.text``, ``parsers.document`` or ``parsers.xml``, never with bare ``float``. The framework then
    accounts for what ``read`` did not use and could be a part of the lens, so nothing has to be looked for; a loader
    of documents of its own is decorated with ``parsers.document.accounted``. Pass the format's own
    ``max_bytes`` to the loaders, so that no file takes more than two seconds; if real files may be longer, use
    ``context.at_most``, which lets the caller raise it. Raise only subclasses of ``InputError``: ``ParseError`` for a
    broken file, ``UnsupportedModelError`` for a camera without a counterpart here. The framework adds the file name, so
    only errors about a companion state their ``source``. Unusual but readable content goes to ``notes``, assumptions to
    ``provenance.assumptions``, other data of the file to ``extras`` under ``"<name>/<key>"``.
5.  ``write(calibrations, context) -> bytes``, if any, needs ``CAPACITY``: the models (preferred first), skew, two focal
    lengths, number of cameras. It gets only calibrations within that capacity: the framework converts or refits others
    within the caller's limit, reads the bytes back, and measures the verdict on them, including lost fields. So a
    writer cannot lose anything silently, and ``read`` must accept the output of ``write``. Write a required element
    last, so that a truncated file cannot be read as another camera.
6.  A format that is only recognised in order to be refused is a row of the table in ``parsers/refused.py``: how it is
    recognised, what it is, why it is refused and what to do instead.
    A format that is only a K and a lens under other names needs no module: it is a row of a table, in the file of
    its kind: ``parsers/formats/_aerial.py``, ``_devices.py``, ``_scenes.py``, ``_slam.py`` or ``_toolboxes.py``.
7.  ``FORMAT = Format(...)`` combines all this, and ``tests/parsers/test_contract.py`` tests it. The format's own test
    contains its formula, computed independently, and one small file per dialect, with invented values; without a
    writer, one of them is its ``SAMPLES = {"<name>": Sample(data)}``. ``make docs`` renews the manual's tables.

Other packages register the same record in the entry-point group ``calibrary.formats``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import Enum, IntEnum, StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeAlias

from msgspec import Struct, field

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance, Quality
from calibrary.distortion import Distortion
from calibrary.errors import InputError, MissingSizeError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention
from calibrary.parsers.on_demand import Columns
from calibrary.provenance import HOW_MADE
from calibrary.records import Json, replace

STATED = tuple(name for name in HOW_MADE if name != "firmware")
"""Fields of provenance that a calibration file may state; the firmware it states is part of the camera."""


class Sure(IntEnum):
    """Certainty of a sniffer; the most certain one wins, two equal ones are an error."""

    WEAK = 1
    SHAPE = 2
    MAGIC = 3


class Sniff(Struct, frozen=True):
    """Result of a sniffer that recognises a file.

    Attributes:
        sure: its certainty.
        reason: what was recognised, for messages: "root <calibration> with <projection>".
    """

    sure: Sure
    reason: str


class Option(Struct, frozen=True, kw_only=True):
    """A fact about a file that only its owner knows.

    Attributes:
        name: as in ``options`` and ``--set name=value``.
        values: the accepted values.
        meaning: the question that it answers, for messages.
    """

    name: str
    values: tuple[str, ...]
    meaning: str


def no_companion(_name: str) -> bytes | None:
    """Companion function for bytes without a folder: there are no other files."""
    return None


class ReadContext(Struct, frozen=True, kw_only=True):
    """Input of a reader besides the bytes.

    Attributes:
        name: file name without folder, for messages and provenance.
        image_size: (width, height) px given by the caller.
        size_is_tried: whether that size is only for cameras without a size in the file.
        options: values of the format's :class:`Option` fields.
        sha256: of the bytes.
        companion: returns the bytes of another file in the same folder by relative name, None if there is none.
        max_bytes: largest file, if the caller raised the limit; None otherwise.
        json: the document, if it was parsed for recognition; a reader must not modify it.
    """

    name: str
    image_size: ImageSize | None = None
    size_is_tried: bool = False
    options: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    sha256: str | None = None
    companion: Callable[[str], bytes | None] = no_companion
    max_bytes: int | None = None
    json: Json = None

    def of_companion(self, name: str) -> ReadContext:
        """The context of a companion."""
        return replace(self, name=name, json=None, sha256=None)

    def at_most(self, own: int) -> int:
        """Largest number of bytes to read: the format's own limit, or the caller's if raised."""
        return max(own, self.max_bytes or 0)

    def option(self, name: str) -> str | None:
        """The caller's value, None if there is none."""
        return self.options.get(name)

    def size(self, found: ImageSize | None) -> ImageSize:
        """The image size: that in the file, else the caller's.

        Raises:
            MissingSizeError: neither is known.
            InputError: they differ; a calibration is read at its own image size and scaled afterwards.
        """
        given = self.image_size
        size = found or given
        if size is None:
            raise MissingSizeError(
                "the file does not state its image size; give it with --image-size WxH, or take twice the principal "
                "point with --size-from-centre",
                source=self.name,
            )
        if found is not None and given is not None and found != given and not self.size_is_tried:
            raise InputError(
                f"the file's images are {found[0]}×{found[1]}, --image-size says {given[0]}×{given[1]}; "
                "leave it out, and scale the calibration once it is read",
                source=self.name,
            )
        return size

    def provenance(
        self,
        *,
        tag: str | None = None,
        assumptions: tuple[str, ...] = (),
        **stated: str | None,
    ) -> Provenance:
        """Make the provenance of a calibration in this file.

        Args:
            tag: the key or element in the file, if it contains several cameras.
            assumptions: assumptions that were made.
            stated: fields of :data:`STATED`, in the file's words. The framework converts a date to ISO 8601; an
                ambiguous or unreadable one becomes a note. Pass no date if the file states none: never the present
                date, nor that of an image or of the file itself.
        """
        made = Provenance(
            kind="calibration-file",
            source=self.name,
            tag=tag,
            sha256=self.sha256,
            assumptions=assumptions,
        )
        return replace(made, **{name: text or None for name, text in stated.items()})

    def calibration(  # noqa: PLR0913 - the fields of a Calibration
        self,
        intrinsics: Intrinsics,
        distortion: Distortion | None,
        *,
        name: str | None = None,
        grade: Grade = Grade.CALIBRATED,
        quality: Quality | None = None,
        notes: Sequence[str] = (),
        extras: Sequence[tuple[str, str]] = (),
        tag: str | None = None,
        assumptions: Sequence[str] = (),
        **stated: str | None,
    ) -> Calibration:
        """Make the calibration of a camera of this file; ``name`` is its name there, if the file has several.

        The rest is as in :class:`~calibrary.calibration.Calibration` and :meth:`provenance`.
        """
        return Calibration(
            camera=CameraKey(image_size=intrinsics.image_size, sub_camera=name),
            intrinsics=intrinsics,
            distortion=distortion,
            grade=grade,
            quality=quality,
            provenance=self.provenance(tag=tag, assumptions=tuple(assumptions), **stated),
            notes=tuple(notes),
            extras=tuple(extras),
        )


class WriteContext(Struct, frozen=True, kw_only=True):
    """Input of a writer besides the calibrations.

    Attributes:
        name: file name; if a format has several syntaxes, its suffix selects one.
    """

    name: str


class UnknownLens(Enum):
    """What a file of the format says of a distortion that is unknown."""

    STATED = "nothing, which reads as unknown"
    FREE = "coefficients of zero, which the program that reads it goes on to find"
    NONE = "that there is none, so the user has to say so"
    NEVER = "nothing, for a file without coefficients is another lens"


class Capacity(Struct, frozen=True, kw_only=True):
    """What a file of the format can represent, and the programs that read it support.

    Attributes:
        models: distortion models, preferred ones first; if empty, only K is written and the distortion reads
            back as unknown.
        skew: whether K[0, 1] may be non-zero.
        two_focals: whether fx may differ from fy.
        off_centre: whether the principal point may differ from the image centre.
        several_cameras: whether a file can contain several calibrations.
        unknown_lens: how a camera with unknown distortion is written. FREE is for programs that adjust cameras: the
            first of ``models`` that has coefficients is written, with zeros.
    """

    models: tuple[type[Distortion], ...]
    skew: bool = False
    two_focals: bool = True
    off_centre: bool = True
    several_cameras: bool = False
    unknown_lens: UnknownLens = UnknownLens.NONE

    @property
    def has_lens(self) -> bool:
        """Whether a file has a place for any distortion."""
        return any(model.names() for model in self.models)


Read: TypeAlias = Callable[[bytes, ReadContext], Sequence[Calibration]]
ReadInPlace: TypeAlias = Callable[[Path, ReadContext], Sequence[Calibration]]
Write: TypeAlias = Callable[[Sequence[Calibration], WriteContext], bytes]


class Format(Struct, frozen=True, kw_only=True):
    """A file format: its conventions, and how it is recognised, read and written.

    Attributes:
        name: name of the module, and value of ``format`` arguments.
        title: common name.
        suffixes: usual suffixes, with dot and in lower case; used only to decide between two WEAK results.
        syntaxes: possible syntaxes of its files; the sniffer is not called for others, which saves most of
            the time of recognition.
        roots: local names of the root elements of its XML files, for the same reason; empty for any.
        words: the format in its own words, and the source; None for the docstring of the module of ``sniff``.
        reference: address of its description.
        convention: conventions of its numbers; None for a format that is only refused.
        sniff: recognises a file; returns None if it is not of this format.
        read: reads all cameras from bytes.
        read_in_place: reads all cameras of a file too long for memory, if single cameras can be looked up in
            it.
        write: makes the bytes of a file from calibrations within ``capacity``.
        capacity: set if and only if ``write`` is.
        write_columns: as ``write``, from the columns of cameras of the format's own models; None if they are others.
        updated: whether cameras can only be written into an existing file, because it contains a whole project.
        needs_image_size: whether files do not state the image size.
        states: fields of :class:`~calibrary.calibration.Provenance` that a file can state, out of
            :data:`STATED`; a writer writes all of them.
        options: facts that the reader may need from the user.
        idle: keys of coefficients, with those above them where they are not clear by themselves, that the lens model
            which the file states may leave unused, or that are of another camera of the file; all other geometry that
            the reader does not use is refused, or makes the distortion unknown (:mod:`calibrary.parsers.account`).
        refuses: why files of the format are never read, and what to do instead.
    """

    name: str
    title: str
    words: str | None = None
    suffixes: tuple[str, ...]
    reference: str
    sniff: Callable[[Content], Sniff | None]
    syntaxes: tuple[Syntax, ...] = tuple(Syntax)
    roots: tuple[str, ...] = ()
    convention: Convention | None = None
    read: Read | None = None
    read_in_place: ReadInPlace | None = None
    write: Write | None = None
    capacity: Capacity | None = None
    write_columns: Callable[[Columns], bytes | None] | None = None
    updated: bool = False
    needs_image_size: bool = False
    states: tuple[str, ...] = ()
    options: tuple[Option, ...] = ()
    idle: tuple[str, ...] = ()
    refuses: str | None = None

    def __post_init__(self) -> None:
        if (self.read is None) == (self.refuses is None):
            raise InputError(f"format {self.name} must either read its files or say why it refuses them")
        if self.read is not None and self.convention is None:
            raise InputError(f"format {self.name} reads, so it must state its convention")
        if self.read is None and self.read_in_place is not None:
            raise InputError(f"format {self.name} reads in place, so it must read bytes as well")
        if (self.write is None) != (self.capacity is None) or (self.write is not None and self.read is None):
            raise InputError(f"format {self.name} must come with write, capacity and read together")
        if not set(self.states) <= set(STATED):
            raise InputError(
                f"format {self.name} may state {', '.join(STATED)}, not {', '.join(self.states)}"
            )


FREE_LENS: Final = "that the distortion is unknown (its coefficients are zero, for the program to find)"
UNKNOWN_LENS: Final = "that the distortion is unknown (the file says that there is none)"
NOT_UNDERSTOOD: Final = "parsers/not_understood"
"""Among a calibration's extras, what its file states of a lens that was not understood."""
LOST_LENS: Final = "the distortion that the file states and that was not understood"
LOST_PX: Final = 0.0005
"""Least displacement by a distortion that is a loss."""


class Fidelity(StrEnum):
    """Result of writing; a refusal is an UnsupportedModelError and leaves no file."""

    EXACT = "exact"
    REFITTED = "refitted"
    K_ONLY = "K only"


class Fit(Struct, frozen=True, kw_only=True):
    """Error of one camera's projection after writing, measured over its image.

    Attributes:
        model: the written distortion model; "unknown" if there is none.
        exact: whether all numbers are equal to 1e-12, or convertible in closed form.
        rms_px, max_px: distance between the projections of the same ray.
        radius_px: distance from the principal point up to which they were compared: the farthest corner,
            unless the original's valid field of view ends before it.
        covered: fraction of the image that was compared.
        lost_px: how far the distortion that the file lacks moves pixels, at most, together with what its K lacks; 0 if
            it lacks no distortion.
    """

    model: str
    exact: bool = True
    rms_px: float = 0.0
    max_px: float = 0.0
    radius_px: float
    covered: float = 1.0
    lost_px: float = 0.0

    @property
    def outcome(self) -> Fidelity:
        """K only if a distortion is lost, else exact or not."""
        if self.lost_px > LOST_PX:
            return Fidelity.K_ONLY
        return Fidelity.EXACT if self.exact else Fidelity.REFITTED

    @property
    def compared_px(self) -> float | None:
        """``radius_px`` if that is not the whole image, else None."""
        return self.radius_px if self.covered < 1.0 else None

    @property
    def error_px(self) -> float:
        """The largest difference, which the user has to accept if it is above the limit."""
        return max(self.max_px, self.lost_px)


def in_words(
    outcome: Fidelity,
    rms_px: float,
    max_px: float,
    radius_px: float | None = None,
    dropped: Sequence[str] = (),
    lost_px: float = 0.0,
) -> str:
    """Say in one line how exactly what was written represents the calibrations.

    Args:
        outcome: of the worst camera.
        rms_px: RMS difference of the projections.
        max_px: largest difference of the projections.
        radius_px: distance from the principal point up to which they were compared; None for the whole image.
        dropped: data that was not written.
        lost_px: how far the distortion that was not written moves pixels, at most, together with what K lost.
    """
    if LOST_LENS in dropped:
        head = f"K only ({max_px:.3f} px)"
    elif outcome is Fidelity.K_ONLY:
        what = (
            "distortion of up to {:.4g} px is lost"
            if max_px <= LOST_PX
            else "what is lost moves pixels by up to {:.4g} px"
        )
        head = f"K only: {what.format(lost_px)}"
    elif outcome is Fidelity.REFITTED:
        within = "" if radius_px is None else f" within {radius_px:.0f} px of the principal point"
        head = f"refitted, {rms_px:.3g} px rms, {max_px:.3g} px at most{within}"
    else:
        unknown = UNKNOWN_LENS in dropped or FREE_LENS in dropped
        head = f"{'K is exact' if unknown else 'exact'} ({max_px:.3f} px)"
    return f"{head}; dropped: {', '.join(dropped)}" if dropped else head


class WriteVerdict(Struct, frozen=True, kw_only=True):
    """How exactly a written file represents the calibrations.

    Attributes:
        fits: one for each camera, in order.
        dropped: data that the file cannot represent, in words; empty if nothing was lost.
    """

    fits: tuple[Fit, ...]
    dropped: tuple[str, ...] = ()

    @property
    def outcome(self) -> Fidelity:
        """That of the worst camera."""
        return max((fit.outcome for fit in self.fits), key=list(Fidelity).index, default=Fidelity.EXACT)

    @property
    def lost_px(self) -> float:
        """Of the worst camera."""
        return max((fit.lost_px for fit in self.fits), default=0.0)

    @property
    def rms_px(self) -> float:
        """Of the worst camera."""
        return max((fit.rms_px for fit in self.fits), default=0.0)

    @property
    def max_px(self) -> float:
        """Of the worst camera."""
        return max((fit.max_px for fit in self.fits), default=0.0)

    @property
    def compared_px(self) -> float | None:
        """Of the camera whose comparison reaches least far; None if the whole image of each was compared."""
        return min((fit.radius_px for fit in self.fits if fit.covered < 1.0), default=None)

    def __str__(self) -> str:
        return in_words(self.outcome, self.rms_px, self.max_px, self.compared_px, self.dropped, self.lost_px)
