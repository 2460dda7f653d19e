"""What a file format is here, and how to add one.

Adding a format touches its module, ``parsers/formats/<name>.py``, and its test, nothing else:

1.  The module's docstring gives the format's own words and a link; its facts are constants at the top.
2.  ``CONVENTION`` states how the format counts (unit, origin, y axis, direction, order of the tangential
    terms). :meth:`Convention.intrinsics` and :meth:`Convention.native` do the counting; a format never adds
    half a pixel.
3.  ``sniff(content) -> Sniff | None`` looks at the shared views of
    :class:`~calibrary.parsers.content.Content` and parses nothing itself; ``syntaxes`` says of which files it is
    asked. ``MAGIC``: a signature that no other format
    has. ``SHAPE``: keys or columns another format might share. ``WEAK``: nothing in the file says so; counts
    only when no other format claims it.
4.  ``read(data, context) -> list[Calibration]`` takes bytes and opens nothing: a file that belongs to it
    comes by ``context.companion(name)``. Every camera in order; with several, ``sub_camera`` is the name the
    file gives each and ``provenance.tag`` its key. ``context.size(found)`` settles the image size,
    ``context.option(name)`` what only the user can know (declare it as an :class:`Option`),
    ``context.provenance(...)`` where it came from: with the date, tool, operator and focus that the file
    itself states, each declared in ``Format.states``, and never one that it does not. Numbers come through
    ``parsers.text``, ``parsers.document`` or ``parsers.xml``, never through bare ``float``, and the loaders are
    told the format's own ``max_bytes``, so that no file takes over two seconds; where real files may be longer,
    through ``context.at_most``, by which the caller can raise it. It raises ``InputError`` kinds
    only: ``ParseError`` for what is broken, ``UnsupportedModelError`` for what has no counterpart here; the
    framework adds the file's name, so that only errors about a companion state their ``source``. What
    is odd but readable goes to ``notes``, what was assumed to ``provenance.assumptions``, what the
    file says beyond that to ``extras`` under ``"<name>/<key>"``.
5.  ``write(calibrations, context) -> bytes``, if any, stands beside ``CAPACITY``: which models (preferred
    first), skew, two focal lengths, how many cameras. It is handed only what fits: the framework has
    converted or refitted the rest within the caller's limit, reads the bytes back, and measures the verdict
    on them, lost fields included. So a writer cannot lose anything silently, and ``read`` must accept what
    ``write`` made. Put what makes a file complete last, so that no cut-off file reads as another camera.
6.  A format that is recognised only to be refused is a row of the table in ``parsers/refused.py``: how it is
    recognised, what it is, why it is refused and what to do instead.
7.  ``FORMAT = Format(...)`` gathers all this. ``tests/parsers/test_contract.py`` takes it from there; the
    format's own test has its formula, computed independently, and one small file per dialect, with values
    of ours.

Third parties put the same record under the entry-point group ``calibrary.formats``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum, StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

from msgspec import Struct, field

from calibrary.calibration import Calibration, ImageSize, Provenance
from calibrary.distortion import Distortion
from calibrary.errors import InputError, MissingSizeError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention
from calibrary.records import Json, replace

__all__ = [
    "STATED",
    "Capacity",
    "Fidelity",
    "Fit",
    "Format",
    "Option",
    "ReadContext",
    "Sniff",
    "Sure",
    "WriteContext",
    "WriteVerdict",
]


STATED = ("date", "tool", "operator", "focus")
"""What a calibration file may state of its own origin."""


class Sure(IntEnum):
    """How sure a sniffer is; the strongest claim wins, two equal ones are an error."""

    WEAK = 1
    SHAPE = 2
    MAGIC = 3


class Sniff(Struct, frozen=True):
    """A format's claim to a file.

    Attributes:
        sure: how strong it is.
        reason: what was seen, for people: "root <calibration> with <projection>".
    """

    sure: Sure
    reason: str


class Option(Struct, frozen=True, kw_only=True):
    """Something about a file that only its owner knows.

    Attributes:
        name: as the caller and ``--set name=value`` spell it.
        values: the accepted ones.
        meaning: the question it answers, for people.
    """

    name: str
    values: tuple[str, ...]
    meaning: str


def no_companion(_name: str) -> bytes | None:
    """Bytes that were given without a folder have no companions."""
    return None


class ReadContext(Struct, frozen=True, kw_only=True):
    """What a reader is told besides the bytes.

    Attributes:
        name: the file's name without its folder, for messages and provenance.
        image_size: (width, height) px as the caller gave it.
        size_is_tried: whether that size is only for the cameras of which the file states none.
        options: answers to the format's :class:`Option` questions.
        sha256: of the bytes.
        companion: the bytes of another file of the same folder by its relative name, None where there is
            none.
        max_bytes: the longest file the caller allows, where that was raised; None otherwise.
        json: the document, where recognising the file took parsing it; a reader only looks at it.
    """

    name: str
    image_size: ImageSize | None = None
    size_is_tried: bool = False
    options: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    sha256: str | None = None
    companion: Callable[[str], bytes | None] = no_companion
    max_bytes: int | None = None
    json: Json = None

    def beside(self, name: str) -> ReadContext:
        """The context of a companion."""
        return replace(self, name=name, json=None, sha256=None)

    def at_most(self, own: int) -> int:
        """How many bytes are read: what the format takes within two seconds, or the caller's limit if raised."""
        return max(own, self.max_bytes or 0)

    def option(self, name: str) -> str | None:
        """The caller's answer, None when there is none."""
        return self.options.get(name)

    def size(self, found: ImageSize | None) -> ImageSize:
        """The image size: the file's own, else the caller's.

        Raises:
            MissingSizeError: neither says it.
            InputError: they differ; a calibration is read in its own frame and scaled afterwards.
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
        date: str | None = None,
        tool: str | None = None,
        operator: str | None = None,
        focus: str | None = None,
    ) -> Provenance:
        """Where a calibration of this file came from.

        Args:
            tag: the key or element inside the file, if it contains several cameras.
            assumptions: what had to be assumed.
            date: of the calibration, as the file writes it. The framework converts it to ISO 8601; a date that
                is ambiguous or cannot be read becomes a note. A file that states none has none: never the
                day of reading, nor the date of an image or of the file itself.
            tool: the program that made the calibration, with its version, as far as the file states it.
            operator: the person or laboratory that made it.
            focus: how the lens was focused, in the file's words.
        """
        return Provenance(
            kind="calibration-file",
            source=self.name,
            tag=tag,
            sha256=self.sha256,
            assumptions=assumptions,
            date=date or None,
            tool=tool or None,
            operator=operator or None,
            focus=focus or None,
        )


class WriteContext(Struct, frozen=True, kw_only=True):
    """What a writer is told besides the calibrations.

    Attributes:
        name: the file's name; where a format has several syntaxes its suffix tells which one is wanted.
    """

    name: str


class Capacity(Struct, frozen=True, kw_only=True):
    """What a file of the format can hold and the programs that read it will honour.

    Attributes:
        models: distortion models, the preferred ones first; with none, K stands alone and reads back with
            unknown distortion.
        skew: K[0, 1] may differ from zero.
        two_focals: fx may differ from fy.
        off_centre: the principal point may lie off the image's middle.
        several_cameras: more than one calibration in a file.
        unknown_lens: a camera of unknown distortion can be written, if only as having none; not where a
            file without coefficients is a fisheye's.
    """

    models: tuple[type[Distortion], ...]
    skew: bool = False
    two_focals: bool = True
    off_centre: bool = True
    several_cameras: bool = False
    unknown_lens: bool = True


Read: TypeAlias = Callable[[bytes, ReadContext], Sequence[Calibration]]
ReadInPlace: TypeAlias = Callable[[Path, ReadContext], Sequence[Calibration]]
Write: TypeAlias = Callable[[Sequence[Calibration], WriteContext], bytes]


class Format(Struct, frozen=True, kw_only=True):
    """One file format, whole: who writes it, how it counts, how it is recognised, read and written.

    Attributes:
        name: the module's name; what callers pass as ``format``.
        title: what people call it.
        suffixes: the usual ones, with their dot, lower case: a hint, never the proof. They break the tie
            between two WEAK claims and nothing else.
        syntaxes: what its files are written in; its sniffer is asked about no other, which is most of the time that
            recognising a file takes.
        reference: where the format is described.
        convention: how its numbers count; None for a format that is only refused.
        sniff: the format's claim to a file, None when it makes none.
        read: every camera in the bytes.
        read_in_place: the same of a file too long to take in, where the format can look its cameras up in it.
        write: one file's bytes from calibrations that fit ``capacity``.
        capacity: present exactly when ``write`` is.
        updated: there is no file without the rest of a project; cameras are written into one that is there.
        needs_image_size: the file does not say how large its images are.
        states: the fields of :class:`~calibrary.calibration.Provenance` that a file can state, out of
            :data:`STATED`; a writer writes them all.
        options: what the reader may have to ask.
        refuses: why files of the format are never read, and what to do instead.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    reference: str
    sniff: Callable[[Content], Sniff | None]
    syntaxes: tuple[Syntax, ...] = tuple(Syntax)
    convention: Convention | None = None
    read: Read | None = None
    read_in_place: ReadInPlace | None = None
    write: Write | None = None
    capacity: Capacity | None = None
    updated: bool = False
    needs_image_size: bool = False
    states: tuple[str, ...] = ()
    options: tuple[Option, ...] = ()
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


class Fidelity(StrEnum):
    """How a write ended; a refused one is an UnsupportedModelError and leaves no file."""

    EXACT = "exact"
    REFITTED = "refitted"


class Fit(Struct, frozen=True, kw_only=True):
    """How much of one camera's projection survived, measured over its image.

    Attributes:
        model: the distortion model afterwards; "unknown" where there is none.
        exact: every number is the same to 1e-12, or has a closed form that is.
        rms_px, max_px: distance between where the two put the same ray.
        radius_px: how far from the principal point the comparison reaches: the farthest corner, unless the
            original folds before it.
        covered: the share of the image it reaches.
    """

    model: str
    exact: bool = True
    rms_px: float = 0.0
    max_px: float = 0.0
    radius_px: float
    covered: float = 1.0


class WriteVerdict(Struct, frozen=True, kw_only=True):
    """How faithfully a written file represents the calibrations.

    Attributes:
        fits: one for each camera, in order.
        dropped: what the file has no place for, in words; empty when nothing was lost.
    """

    fits: tuple[Fit, ...]
    dropped: tuple[str, ...] = ()

    @property
    def outcome(self) -> Fidelity:
        """Exact when every camera is."""
        return Fidelity.EXACT if all(fit.exact for fit in self.fits) else Fidelity.REFITTED

    @property
    def rms_px(self) -> float:
        """Of the worst camera."""
        return max((fit.rms_px for fit in self.fits), default=0.0)

    @property
    def max_px(self) -> float:
        """Of the worst camera."""
        return max((fit.max_px for fit in self.fits), default=0.0)

    @property
    def radius_px(self) -> float:
        """Of the camera whose comparison reaches least far."""
        return min((fit.radius_px for fit in self.fits), default=0.0)

    def __str__(self) -> str:
        if self.outcome is Fidelity.EXACT:
            head = "exact"
        else:
            head = (
                f"refitted: rms {self.rms_px:.3g} px, max {self.max_px:.3g} px "
                f"within {self.radius_px:.0f} px of the principal point"
            )
        return f"{head}; dropped: {', '.join(self.dropped)}" if self.dropped else head
