"""Reading of calibrations from bytes: recognition of the format, call of its reader, and what no camera can have.

A file that no format recognises is described: what it probably is instead, and the next step. A text without a newline
at its end may be cut short: some editors and programs omit the last newline, and an incomplete copy lacks it too. To
distinguish them, the last number is extended: if another ending (3650.1 → 3650.11, 3650.1e1) does not change the
result, the number is not used and the file is accepted. If it does, the number may lack digits: a fraction with as
many decimals as any other of the file is accepted with a note, anything else is refused.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

from msgspec import Struct

from calibrary.admission import admission
from calibrary.calibration import Calibration, ImageSize
from calibrary.dates import iso_date
from calibrary.errors import (
    AmbiguousFormatError,
    InputError,
    MissingTagError,
    ParseError,
    UnknownFormatError,
    UnsupportedModelError,
)
from calibrary.parsers.account import Account
from calibrary.parsers.content import HEAD_BYTES, UTF_16, Content, Syntax, ended
from calibrary.parsers.discovery import BY_HAND, format_named, formats_of, known_formats
from calibrary.parsers.document import Documents, keeping
from calibrary.parsers.files import MAX_BYTES, display_name, read_head, too_long
from calibrary.parsers.format import Format, Read, ReadContext, Sniff, Sure, no_companion
from calibrary.parsers.on_demand import REACH, CamerasOnDemand
from calibrary.parsers.text import shown
from calibrary.parsers.unsized import TRIED
from calibrary.records import replace
from calibrary.validation import Severity


class Identity(Struct, frozen=True):
    """The recognised format of a file.

    Attributes:
        format: the format with the highest certainty.
        sniff: result of its sniffer.
    """

    format: Format
    sniff: Sniff


def identified(content: Content) -> Identity:
    """Recognise the format of a file.

    Raises:
        UnknownFormatError: no format recognises the bytes.
        AmbiguousFormatError: two formats are equally certain; the message names both.
    """
    root = content.xml_root
    claims = [
        Identity(record, sniff)
        for record in formats_of(content.syntax)
        if not (root and record.roots and root not in record.roots)
        if (sniff := record.sniff(content)) is not None
    ]
    if not claims:
        by_hand = format_named(BY_HAND)
        sniff = by_hand.sniff(content)
        if sniff is None:
            raise UnknownFormatError(described(content), source=content.name)
        return Identity(by_hand, sniff)
    strongest = max(claim.sniff.sure for claim in claims)
    best = [claim for claim in claims if claim.sniff.sure == strongest]
    if strongest is Sure.WEAK and len(best) > 1:
        # The content does not decide, so the file name may.
        best = [claim for claim in best if content.suffix in claim.format.suffixes] or best
    if len(best) > 1:
        sentence = " and ".join(f"{claim.format.name} ({claim.sniff.reason})" for claim in best)
        raise AmbiguousFormatError(
            f"it is claimed equally by {sentence}; say which with --format NAME", source=content.name
        )
    return best[0]


def read_content(
    content: Content,
    *,
    record: Format | None = None,
    image_size: ImageSize | None = None,
    size_is_tried: bool = False,
    options: Mapping[str, str] | None = None,
    companion: Callable[[str], bytes | None] = no_companion,
    max_bytes: int = MAX_BYTES,
) -> Sequence[Calibration]:
    """Read all cameras from a file's content.

    Args:
        content: the file.
        record: the format; None to recognise it.
        image_size: (width, height) px, for files that do not state it.
        size_is_tried: whether the file may state another size.
        options: values of the format's options.
        companion: reads other files in the same folder.
        max_bytes: largest file; a value above the default also raises the formats' own limits.

    Raises:
        InputError: as for :func:`calibrary.parsers.read`.
    """
    _refuse_unmerged(content)
    sure = None
    documents = Documents()
    if record is None:
        with keeping(documents):
            identity = identified(content)
        record, sure = identity.format, identity.sniff.sure
    read = record.read
    if read is None:
        raise UnsupportedModelError(f"this is {record.title}: {record.refuses}", source=content.name)
    context = ReadContext(
        name=content.name,
        image_size=image_size,
        size_is_tried=size_is_tried,
        options=_checked(options or {}, record),
        sha256=hashlib.sha256(content.data).hexdigest(),
        companion=companion,
        max_bytes=max_bytes if max_bytes > MAX_BYTES else None,
        json=content.parsed_json,
    )

    with _errors_of(content.name):
        data = content.data if content.text is None else ended(content.data)
        account = Account(record, data, context, documents, is_text=content.text is not None)
        with keeping(account.documents):
            found = (
                read(data, account.context)
                if content.text is None
                else read_to_the_end(read, content.data, account.context)
            )
        calibrations = account.settled(_checked_cameras(found, record, content.name))
    is_sized = not (size_is_tried and image_size in TRIED)
    if sure is Sure.WEAK:
        for item in calibrations if is_sized else ():
            doubt = admission(item)
            if doubt is not None and doubt.severity is Severity.ERROR:
                is_by_hand = record.name == BY_HAND
                says = "its names alone say" if is_by_hand else "nothing in the file says"
                raise ParseError(
                    f"{says} that it is {'a camera' if is_by_hand else record.title}, and read so, {doubt.message}; if "
                    f"that is what it is, say so with --format {record.name}",
                    source=content.name,
                )
    if sure is Sure.WEAK and record.name != BY_HAND:
        note = f"nothing in the file says that it is {record.title}; it was read so because it has the shape"
        calibrations = [replace(item, notes=(*item.notes, note)) for item in calibrations]
    return calibrations


def _refuse_unmerged(content: Content) -> None:
    """Refuse a text in which git left two versions.

    Raises:
        ParseError: it has git's marks of a conflict, on the lines from the first to the last.
    """
    text = content.text or ""
    if OURS not in text:
        return
    rows = text.splitlines()
    marked = [
        (number, row[:8]) for number, row in enumerate(rows, start=1) if row[:8] in (OURS, BETWEEN, THEIRS)
    ]
    if [mark for _, mark in marked[:3]] == [OURS, BETWEEN, THEIRS]:
        raise ParseError(
            "an unresolved merge of git: keep one of the versions, and remove the marks <<<<<<<, ======= and >>>>>>>",
            source=content.name,
            place=f"lines {marked[0][0]} to {marked[2][0]}",
        )


def identified_by_head(path: Path, *, max_bytes: int) -> Identity:
    """Recognise a file too long for memory, if its format can look up single cameras in it.

    Raises:
        ParseError: it is not of such a format.
        InputError: the file cannot be read, or is not a regular file.
    """
    content = Content(read_head(path, HEAD_BYTES), display_name(path))
    for record in known_formats().values():
        if record.read_in_place is not None and (sniff := record.sniff(content)) is not None:
            return Identity(record, sniff)
    raise too_long(content.name, max_bytes)


def read_in_place(
    path: Path,
    record: Format,
    *,
    image_size: ImageSize | None,
    options: Mapping[str, str] | None,
    companion: Callable[[str], bytes | None],
    max_bytes: int,
) -> Sequence[Calibration]:
    """Read all cameras in a file too long for memory; their provenance has no digest.

    Raises:
        ParseError: the format can only read whole files.
        InputError: as for :func:`calibrary.parsers.read`.
    """
    name = display_name(path)
    read = record.read_in_place
    if read is None:
        raise too_long(name, max_bytes)
    context = ReadContext(
        name=name, image_size=image_size, options=_checked(options or {}, record), companion=companion
    )
    with _errors_of(name):
        return _checked_cameras(read(path, context), record, name)


@contextmanager
def _errors_of(name: str) -> Iterator[None]:
    """Make errors on an invalid K or lens errors of the file."""
    try:
        yield
    except InputError as error:
        if error.source is not None:
            raise
        kind = ParseError if type(error) is InputError else type(error)
        raise kind(error.message, source=name, place=error.place) from None


def _checked_cameras(calibrations: Sequence[Calibration], record: Format, name: str) -> Sequence[Calibration]:
    """The cameras of a file with their dates in ISO 8601, after checking that pixels can be computed with them."""
    made = calibrations.made_at_once() if isinstance(calibrations, CamerasOnDemand) else calibrations
    if not calibrations:
        raise ParseError(f"this {record.title} file contains no camera", source=name)
    for item in made:
        _refuse_beyond_reach(item, name)
    return [_dated(item) for item in calibrations] if "date" in record.states else calibrations


def _dated(item: Calibration) -> Calibration:
    """The calibration with its date in ISO 8601; an unreadable date becomes a note."""
    text = item.provenance.date
    if text is None or (iso := iso_date(text)) == text:
        return item
    if iso is None:
        note = f"the file's date, {shown(text)}, is ambiguous or not a date, so the date is unknown"
        item = replace(item, notes=(*item.notes, note))
    return replace(item, provenance=replace(item.provenance, date=iso))


def _refuse_beyond_reach(item: Calibration, name: str) -> None:
    """Refuse numbers that are finite and positive, but unusable for computing pixels.

    Raises:
        ParseError: a length of K exceeds 10⁶ image sides, or a focal length is below 10⁻⁶ of one.
    """
    K = item.intrinsics
    side = max(K.image_size)
    if min(K.fx, K.fy) * REACH < side or max(K.fx, K.fy, abs(K.cx), abs(K.cy), abs(K.skew)) > REACH * side:
        raise ParseError(
            f"its K, with fx {K.fx:g}, fy {K.fy:g}, cx {K.cx:g}, cy {K.cy:g}, skew {K.skew:g} px, is of no camera "
            f"with images of {K.image_size[0]}×{K.image_size[1]} px",
            source=name,
            place=item.provenance.tag,
        )


def _checked(options: Mapping[str, str], record: Format) -> Mapping[str, str]:
    known = {option.name: option for option in record.options}
    for name, value in options.items():
        if name not in known:
            if name == "origin":
                raise InputError(
                    f"files of format {record.name} all count from the same origin; leave --pixel-origin out"
                )
            listed = ", ".join(known) or "none"
            raise InputError(f"format {record.name} asks nothing called {name!r}; it knows {listed}")
        if value not in known[name].values:
            raise InputError(f"{name} is {value!r}, expected one of {', '.join(known[name].values)}")
    return options


LISTED_KEYS = 8

_ZIP = b"PK\x03\x04"
_MARKS = (
    (b"\x1f\x8b", "it is compressed with gzip; decompress it first (gunzip)"),
    (b"BZh", "it is compressed with bzip2; decompress it first (bunzip2)"),
    (b"\xfd7zXZ\0", "it is compressed with xz; decompress it first (unxz)"),
    (b"\x28\xb5\x2f\xfd", "it is compressed with Zstandard; decompress it first (unzstd)"),
    (_ZIP, "it is a ZIP archive; unpack it, and give the calibration file in it"),
    (b"7z\xbc\xaf\x27\x1c", "it is a 7z archive; unpack it, and give the calibration file in it"),
    (b"%PDF-", "it is a PDF; export the calibration from its program in a format of `calibrary formats`"),
)
_NUMPY_MEMBER = re.compile(rb"([\w.-]{1,60})\.npy")
_HTML = re.compile(r"<!doctype html|<html\b", re.IGNORECASE)
_HTML_STEP = "it is an HTML page, as servers send in place of a file; download the file itself"


def described(content: Content) -> str:
    """What a file that no format recognises contains, and the next step."""
    if content.data.startswith(_ZIP) and (arrays := _NUMPY_MEMBER.findall(content.data)):
        return f"no format claims it: {_of_arrays(arrays)}"
    for mark, sentence in _MARKS:
        if content.data.startswith(mark):
            return f"no format claims it: {sentence}"
    text = content.text
    if text is not None and not content.lines:
        return "no format claims it: it is blank; export or copy it again"
    if text is not None and _HTML.match(text.lstrip()):
        return f"no format claims it: {_HTML_STEP}"
    if content.doctype is not None:
        return (
            f"no format claims it: it is XML with a document type, <!DOCTYPE {content.doctype} …>, which is not read "
            "because its entities can be without end; remove that declaration if the file is a calibration"
        )
    message = f"no format claims it; it begins with {content.beginning()}"
    if content.syntax is Syntax.JSON and content.json is None:
        # A valid document that begins like an object or a list would not be None.
        return f"{message}, and {_why_no_json(content)}"
    return f"{message}{_contents(content)}; if you know what it is, say so with --format NAME"


def _of_arrays(members: list[bytes]) -> str:
    listed = _joined_names(dict.fromkeys(name.decode("ascii", "replace") for name in members))
    return (
        f"it is a zip archive of numpy arrays, {listed}, and none has a camera matrix's name; save it again with"
        " np.savez(…, camera_matrix=…, dist_coeffs=…)"
    )


def _why_no_json(content: Content) -> str:
    error = content.json_error
    if error is None:
        return (
            f"JSON of over {content.max_json_bytes} bytes is not looked into unless --max-size-mib is raised"
        )
    why = f"{error.message} at {error.place}" if error.place else error.message
    return f"{why}; it may be cut short or edited: export or copy it again"


def _contents(content: Content) -> str:
    """Describe the top-level keys, and whether it is another kind of OpenCV file."""
    tags = tuple(dict.fromkeys(content.xml_tags))
    keys = tags[:1] if len(tags) == 1 else tags[1:] if tags else content.json_keys or content.yaml_keys
    if not keys:
        return ""
    listed = _joined_names(keys)
    if content.xml_root == "opencv_storage" or content.first_line.startswith("%YAML:1.0"):
        return f"; it is a file of OpenCV's without a camera matrix: it contains {listed}"
    return f"; it contains {listed}"


def _joined_names(names: Iterable[str]) -> str:
    first, more = tuple(islice(names, LISTED_KEYS + 1)), ""
    if len(first) > LISTED_KEYS:
        first, more = first[:LISTED_KEYS], ", …"
    return ", ".join(map(shown, first)) + more


OURS, BETWEEN, THEIRS = "<<<<<<< ", "=======", ">>>>>>> "
"""Beginnings of the lines with which git marks two versions."""
NOT_ENDED = "the last line is not ended, so the file may be cut short; complete it, or end it with a newline"

_CLOSED = tuple("]})>\"';")
"""Characters after which no number can continue."""
_LAST_WORD = re.compile(r"[^\s,;:=]*\s*\Z")
_DIGIT = re.compile(r"\d")
_ZERO = re.compile(r"[+-]?0")
_WHOLE = re.compile(r"\d[eE][+-]0\d\Z")
"""An exponent padded to two digits, which has no third digit if it begins with 0."""
_ANOTHER = " 1"
_FRACTION = re.compile(r"(?<![\w.+-])[+-]?\d+\.\d+(?![\w.])")
_EXPONENTS = re.compile(r"\d[eE][+-]?\d")
"""Where numbers have exponents, the last one may lack its own."""
FEWEST_OTHERS = 4
"""Fractions that a text needs to tell how many decimals its numbers have."""
_EXPONENT = re.compile(r"[\d.][eE][+-]?\d*\Z")
_TAIL_BYTES = 2000


def read_to_the_end(read: Read, data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """Run a reader on a text, which is passed with a newline at its end.

    Extras that may be truncated are omitted, with a note.

    Args:
        read: the reader.
        data: content of a text file.
        context: of the file.

    Raises:
        ParseError: the last line has no newline, and its last word is used.
        InputError: raised by the reader.
    """
    encoding = UTF_16.get(data[:2], "utf-8")
    newline = "\n".encode(encoding)
    tail = data[-_TAIL_BYTES:].decode(encoding, "replace")
    if tail.endswith(("\n", "\r")) or tail.rstrip().endswith(_CLOSED):
        return read(ended(data), context)
    try:
        found = read(data + newline, context)
    except MissingTagError:
        raise
    except InputError as error:
        if _fails_without_its_last_line(read, data, context, newline, error):
            raise
        raise ParseError(f"{error.message}; {NOT_ENDED}", source=error.source, place=error.place) from None
    match = _LAST_WORD.search(tail)
    word = match[0].strip() if match else ""
    if word and not _DIGIT.search(word):
        return found
    if _is_as_long_as_others(word, tail):
        note = f"{NOT_ENDED}: its last number, {shown(word)}, was taken as it stands"
        return [replace(item, notes=(*item.notes, note)) for item in found]
    for ending in _endings(word):
        try:
            other = read(data + ending.encode(encoding) + newline, context)
        except InputError:
            # No further number can follow a complete one.
            other = found if ending == _ANOTHER else []
        if [_camera(item) for item in other] != [_camera(item) for item in found]:
            raise ParseError(f"{NOT_ENDED}: what it ends in, {shown(word)}, is used")
        found = [_common(item, changed) for item, changed in zip(found, other, strict=True)]
    return found


def _fails_without_its_last_line(
    read: Read, data: bytes, context: ReadContext, newline: bytes, error: InputError
) -> bool:
    """Whether the file without its last line has the same error, so that truncation is not the cause."""
    kept, found, _ = data.rpartition(newline)
    try:
        read(kept + newline if found else b"", context)
    except InputError as other:
        return (type(other), other.message, other.place) == (type(error), error.message, error.place)
    return False


def _is_as_long_as_others(word: str, text: str) -> bool:
    """Whether a word is a fraction of as many decimals as any other of a text, and so lacks no more than they do."""
    *others, last = _FRACTION.findall(text) or [""]
    if last != word or len(others) < FEWEST_OTHERS or not float(word) or _EXPONENTS.search(text):
        return False
    return len(word.partition(".")[2]) >= max(len(other.partition(".")[2]) for other in others)


def _endings(word: str) -> Iterator[str]:
    """Yield possible continuations: more digits, or an exponent if there is none; after an integer another number."""
    if _WHOLE.search(word):
        yield _ANOTHER
        return
    yield ".5" if _ZERO.fullmatch(word) else "1"
    if not _EXPONENT.search(word):
        yield "e1"


def _camera(item: Calibration) -> Calibration:
    return replace(item, notes=(), extras=())


def _common(item: Calibration, changed: Calibration) -> Calibration:
    """The calibration without the extras and notes that depend on the last word."""
    extras = tuple(pair for pair in item.extras if pair in changed.extras)
    notes = tuple(note for note in item.notes if note in changed.notes)
    lost = [name for name, _ in item.extras if name not in dict(extras)]
    if lost:
        notes += (f"{', '.join(lost)} is left out: the last line is not ended, so it may be cut short",)
    return replace(item, extras=extras, notes=notes)
