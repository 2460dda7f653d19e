"""The account of a file: whether the reader used every statement that could be part of a lens.

A reader takes what it knows by name. What a file states under another name would be dropped, and a lens with it, so the
framework looks through the document after every reading, in whatever container it came: trees of JSON, YAML, TOML,
OpenCV, npz and MATLAB files, XML, lines of keys and values. It collects the statements that could be geometry:

*   numbers under a key that names a distortion (``radial``, ``dist_coefs``, ``k3``), or in a table with such a name;
*   a text that names a lens model (``distortion_model: fisheye``);
*   an unnamed vector of 4 to 14 numbers beside K, where no lens was read;
*   an unused short key beside coefficients that were used (a misspelt ``k3``).

A statement is used if changing it changes what is read. Most are used in the obvious way, their numbers being those of
the result, or their text the name of its lens; only for the others is the changed document read again. One that is not
used may be explained: it states the lens that was read once more, it is of another sensor or of the board, or the
reader set it aside, as what another statement supersedes. If it is not explained, the distortion of the cameras without
a lens becomes unknown, never none, and a note names the key; a file with a lens is refused, because its lens would not
be the one that the file states.
"""

from __future__ import annotations

import math
import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

from msgspec import Struct

from calibrary.arrays import np
from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import InputError, ParseError
from calibrary.parsers import names
from calibrary.parsers import text as strict
from calibrary.parsers.document import Documents, Node, keeping
from calibrary.parsers.format import NOT_UNDERSTOOD, Format, ReadContext
from calibrary.records import Json, replace

MOST_NODES = 4000
"""Values of a document that are looked at: a reconstruction repeats its keys."""
LONG = 100
"""Of longer lists and tables the first and the last items are looked at, half as many of each."""
LONGEST_VECTOR = 64
MOST_TESTED = 48
"""Statements for which a file is read again one by one; more are tested together."""
MOST_ALIKE = 4
"""The same of those with one key at one depth."""
SHOWN = 4
LONGEST_PATH = 60
"""Characters of a path that are shown, the last ones."""
REACH = 3
"""Tables around a focal length in which a vector is beside K."""
VECTOR = range(4, 15)
"""Lengths of a vector that could be a lens."""
OF_A_LENS, MISSPELT, UNNAMED = "of a lens", "a misspelt coefficient", "an unnamed vector"
LARGEST = 1e4
"""Coefficients are smaller; larger numbers are counts, sizes or times."""
PRINTED = 6e-7
"""Half of the last of six decimals, with which some programs print a number again."""
TURNED = 1e-3
"""Largest departure of a rotation's rows from unit length."""
LONGEST_TEXT = 2000
HEAD = 256 * 1024
"""Characters of a text without a known container that are looked at."""

_SEPARATORS = re.compile(r"[\W_]+")
_DIGIT = re.compile("[1-9]")
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_NUMBERS = re.compile(_NUMBER)
_BEGINS_A_NUMBER = frozenset("0123456789+-.[({ \t\r\n")
_ALL_NUMBERS = re.compile(rf"[\s\[({{]*+{_NUMBER}(?:[\s,;\[\](){{}}]+{_NUMBER})*+[\s\])}},;]*")
_LINE = re.compile(
    r"^[ \t]{0,20}[\"']?([A-Za-z][\w .\-]{0,60}?)[\"']?[ \t]{0,20}[=:][ \t]{0,20}(?![=:])([^\s#].{0,2000}?)[ \t\r]*$",
    re.MULTILINE,
)
_WORDS = r"(?<!un)dist(?:ort|co)|coeff?dist|radial|tangent|decent(?:er|r)ing|thinprism|lenscoef|lensparam"
_LENS = re.compile(_WORDS)
_OF_A_LENS = re.compile(rf"{_WORDS}|(?<!un)dist(?:co|param|vec|\d|left|right|[lr]?\Z)")
_TABLE_OF_A_LENS = re.compile(rf"{_WORDS}|(?<!un)dist(?:co|param|left|right|s?\Z)")
_VECTOR_OF_A_LENS = re.compile(
    r"(?:left|right|cam(?:era)?\d*)?(?:d|kc|kd|coeffs?|coefs?|coefficients)(?:left|right|l|r|\d+)?"
)
_COEFFICIENT = re.compile(
    r"(?:\A|[^A-Za-z])(?:(?:kc?|kr)_?\d{1,2}(?:\Z|[^\w]|_)|(?:[psb]_?\d{1,2}|xi|tau_?[xy12])\Z)",
    re.IGNORECASE,
)
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_ABOUT_NUMBERS = re.compile(
    "(?:std|stdev|stddev|sigmas?|dev|err|cov|var|acc|rms|rmse|min|max|tol|fix|fixed|is|has|use|uses)|(?:error|deviation|covarian"
    "|varian|uncertain|accura|resid|confid|flag|enable|estimat|optimi[sz]|limit|thresh|toler|weight|undist|vignet|distance"
    "|correl|rotat|quat|pose|position|translat|extrin|interpol|criteri|sigma|rectif).*"
)
"""Words in keys of what is said about coefficients, or of what is none."""
_ERRORS = re.compile("errors?|deviations?|uncertaint(?:y|ies)|covariances?|variances?")
_ABOUT_WHAT = re.compile(rf"{_WORDS}|dist|intrin|calib|param|coef|focal|princip|(?:\A|[^a-z])[kpsb]\d")
_BESIDE = re.compile(
    "rot|quat|orient|trans|pose|extr|proj|rect|roi|bound|box|crop|pos|colou?r|rgb|range|imu|acc|gyr|size|resol|shape|time"
    "|date|board|pattern|grid|noise|plane|gps|lat|lon|bias|gravity|frame|aabb|offset|view|essential|fundamental|homogr"
    "|rvec|tvec|corner|point|vertex|gamma|white|black|gain|expos|bodyt|tbs|tcam|tci|tic"
)
"""In keys of other vectors that files have beside K."""
_SHORT = re.compile(r"(?!d[xy]\d)\w?[kp]\w?|(?!d[xy]\d)\w?\w?\d|[kpsb]\d(?:px|x|mm|coef\w*)")
"""Keys that could be a misspelt coefficient, beside others."""
_NAMED = re.compile(r"(?:camera|cam|lens|dist(?:ortion)?|radial|tangential|coef\w*?)?([kpsb]\d|xi|tau[xy])")
"""A coefficient by the name that it has here."""
_OF_SOMETHING_ELSE = re.compile(
    r"(?:imu|accel(?:erometer)?|gyro(?:scope)?|mag(?:netometer)?|lidar|velodyne|laser|radar|gps|gnss|odom(?:etry)?|baro"
    r"|(?:calib(?:ration)?)?(?:board|target|pattern)|(?:checker|chess)board|charuco)(?:s|\d+)?"
)
"""Tables of other sensors, and of what was photographed."""
_MODEL_KEY = re.compile(r"(?:distort|lens|camera|projection|cam).*(?:model|type)|\Amodel(?:type)?\Z")


class _Slot(Struct, frozen=True):
    """The place of a number or text: a key of a container, or a part of the text there.

    Attributes:
        holder: the container.
        key: in it.
        value: the number, or the text if it is none; empty for a truth value and nothing.
        span: of the number in the text.
    """

    holder: Any
    key: Any
    value: float | str
    span: tuple[int, int] | None = None

    def get(self) -> Json:
        """The content of the place."""
        return _content(self.holder, self.key)

    def put(self, raw: Json) -> None:
        """Replace the content of the place."""
        holder: Any = self.holder
        if self.key is None:
            holder.text = raw
        elif isinstance(holder, dict | list | _Lines):
            holder[self.key] = raw
        else:
            holder.set(self.key, raw)

    def holds_one_of(self, known: set[float | str]) -> bool:
        """Whether what is there is one of these, but for a number's sign."""
        value = self.value
        return (value if isinstance(value, str) else abs(value)) in known

    def change(self) -> None:
        """Change the number or the text."""
        raw = self.get()
        if isinstance(raw, str):
            start, end = self.span or (len(raw), len(raw))
            digit = _DIGIT.search(raw, start, end)
            at = digit.start() if digit else end
            self.put(raw[:at] + (str(int(raw[at]) % 9 + 1) if digit else "x") + raw[at + bool(digit) :])
        elif isinstance(raw, int | float):
            self.put(raw * 1.01 if isinstance(raw, float) else raw + 1)


def _content(holder: Any, key: Any) -> Json:
    """What a container holds under a key; of an element, the text without one."""
    of_element = not isinstance(holder, dict | list | _Lines)
    raw: Json = (holder.text if key is None else holder.get(key)) if of_element else holder[key]
    return raw


class Statement(Struct, frozen=True):
    """One statement of a file that could be geometry.

    Attributes:
        path: keys from the document to it, without the positions in lists.
        slots: its numbers that are not zero, or its text.
    """

    path: tuple[str, ...]
    slots: tuple[_Slot, ...]

    def is_in(self, notes: str) -> bool:
        """Whether notes speak of it, by its key or its text."""
        text = self.slots[0].value
        words = [self.path[-1], text] if isinstance(text, str) and text else [self.path[-1]]
        return any(re.search(rf"(?<!\w){re.escape(word)}(?!\w)", notes) for word in words)

    @property
    def is_a_name(self) -> bool:
        """Whether it is the name of a lens."""
        return isinstance(self.slots[0].value, str)

    def __str__(self) -> str:
        values = [slot.value for slot in self.slots]
        shown = " ".join(f"{value:g}" if isinstance(value, float) else value for value in values[:4])
        more = " …" if len(values) > 4 else ""
        path = ".".join(self.path)
        path = path if len(path) <= LONGEST_PATH else f"…{path[1 - LONGEST_PATH :]}"
        return f"{strict.shown(path, LONGEST_PATH)} ({strict.shown(shown, 60)[1:-1]}{more})"


class Account:
    """The account of one reading, which takes place while :attr:`documents` are kept.

    Attributes:
        documents: what the reader loads.
    """

    def __init__(
        self, record: Format, data: bytes, context: ReadContext, documents: Documents, *, is_text: bool
    ) -> None:
        self._record = record
        self._data = data
        self._is_text = is_text
        self.documents = documents
        self._companions: set[bytes] = set()

        def companion(name: str) -> bytes | None:
            found = context.companion(name)
            if found is not None:
                self._companions.add(found)
            return found

        self.context = replace(context, companion=companion)

    def settled(self, cameras: Sequence[Calibration]) -> Sequence[Calibration]:
        """The cameras, without a lens that the file may state otherwise.

        Raises:
            ParseError: the file states a part of a lens that the reader does not use.
        """
        if not isinstance(cameras, list) or not (self.documents.loaded or self._is_text):
            return cameras
        bare = [item.distortion is None or isinstance(item.distortion, NoDistortion) for item in cameras]
        unused = self._unused(cameras, is_bare=any(bare))
        if not unused:
            return cameras
        listed = ", ".join(map(str, unused[:SHOWN])) + (", …" if len(unused) > SHOWN else "")
        if any(bare):
            note = f"not understood, so the distortion is unknown: {listed}"
            stated = (NOT_UNDERSTOOD, listed)
            return [
                replace(item, distortion=None, notes=(*item.notes, note), extras=(*item.extras, stated))
                if is_bare
                else item
                for item, is_bare in zip(cameras, bare, strict=True)
            ]
        raise ParseError(self._remedy(unused, cameras), place=listed)

    def _remedy(self, unused: Sequence[Statement], cameras: Sequence[Calibration]) -> str:
        """What could be a part of the lens, and what to do about it."""
        title = self._record.title
        if all(one.is_a_name for one in unused):
            models = ", ".join(dict.fromkeys(item.distortion.model for item in cameras if item.distortion))
            return (
                f"it names a lens where {title} has no place for a name, and without it the lens was read as {models}; "
                f"state the model where {title} does if it is another, or remove the name if it is not"
            )
        wanted = self._record.convention.coefficients if self._record.convention is not None else ()
        expected = f"; expected {', '.join(wanted)}" if wanted else ""
        return (
            f"it could be a part of the lens, and is nothing that {title} has{expected}: give it the name of the one "
            "that it is, or remove it if it is none"
        )

    def _unused(self, cameras: Sequence[Calibration], *, is_bare: bool) -> list[Statement]:
        """The statements that could be geometry, on which no camera depends and of which no note speaks."""
        focals = {number for item in cameras for number in (item.intrinsics.fx, item.intrinsics.fy)}
        groups: dict[tuple[str, ...], list[Statement]] = {}
        aside = {*map(id, self.documents.aside)}
        for document in self._documents():
            for statement in _statements_of(document, focals, aside, is_bare=is_bare):
                groups.setdefault(statement.path, []).append(statement)
        known = _explained(cameras, groups.values())
        lens = _only_lens(cameras)
        unsure: list[tuple[Statement, list[list[_Slot]]]] = []
        for statements in groups.values():
            others = [one for one in statements if not _states_again(one, lens)]
            slots = [slot for one in others for slot in one.slots if not slot.holds_one_of(known)]
            if slots:
                unsure.append((statements[0], [slots] if len(statements) > 1 else [[slot] for slot in slots]))
        before = [_numbers_of(item) for item in cameras] if unsure else []
        # A file of many cameras states the same key of each below the camera's name: some stand for all.
        alike = Counter[tuple[int, str]]()
        each: list[tuple[Statement, list[list[_Slot]]]] = []
        rest: list[tuple[Statement, list[list[_Slot]]]] = []
        for one, tests in unsure:
            alike[kin := (len(one.path), one.path[-1])] += 1
            (each if alike[kin] <= MOST_ALIKE and len(each) < MOST_TESTED else rest).append((one, tests))
        lost = [one for one, tests in each if not all(self._matter(test, before) for test in tests)]
        if rest and not self._matter([slot for _, tests in rest for test in tests for slot in test], before):
            lost += [one for one, _ in rest]
        said = " ".join(note for item in cameras for note in item.notes) if lost else ""
        idle = tuple(f".{key}" for key in self._record.idle)
        return [one for one in lost if not one.is_in(said) and not f".{'.'.join(one.path)}".endswith(idle)]

    def _matter(self, slots: Sequence[_Slot], before: Sequence[Calibration]) -> bool:
        """Whether the cameras depend on what is there; a changed number that is refused matters as well."""
        kept = [(slot, slot.get()) for slot in slots]
        lines = next((slot.holder for slot in slots if isinstance(slot.holder, _Lines)), None)
        try:
            for slot in slots:
                slot.change()
            after = self._replayed(lines.data() if lines is not None else self._data)
        except InputError:
            return True
        finally:
            for slot, raw in reversed(kept):
                slot.put(raw)
        return [_numbers_of(item) for item in after] != before

    def _replayed(self, data: bytes) -> Sequence[Calibration]:
        """Read, from the documents that were loaded before."""
        with keeping(self.documents):
            return self._record.read(data, self.context) if self._record.read is not None else ()

    def _documents(self) -> list[object]:
        """Of each loader the first document; the next ones are of the text with another ending, or companions."""
        found: dict[str, object] = {}
        for (loader, data), document in self.documents.loaded.items():
            if data not in self._companions:
                found.setdefault(loader, document)
        return list(found.values()) or ([_Lines(self._data)] if self._is_text else [])


def _explained(cameras: Sequence[Calibration], groups: Iterable[Sequence[Statement]]) -> set[float | str]:
    """Magnitudes that are numbers of K or coefficients of the cameras at least as often as the file states them.

    Beside them texts that name the lens of all the cameras, and no other.
    """
    read = Counter(
        abs(value) for item in cameras if item.distortion for value in item.distortion.coefficients.values()
    )
    for item in cameras:
        K = item.intrinsics
        read.update({K.fx, K.fy, K.cx, K.cy, K.cx - 0.5, K.cy - 0.5})
    values = [slot.value for statements in groups for one in statements for slot in one.slots]
    stated = Counter(abs(value) for value in values if isinstance(value, float))
    known: set[float | str] = {value for value, count in read.items() if stated[value] <= count}
    kinds: set[type] = {type(item.distortion) for item in cameras}
    if len(kinds) == 1 and (words := names.OWN.get(kinds.pop().__name__)):
        known |= {
            one for one in values if isinstance(one, str) and names.simplified(one.strip("\"' ")) in words
        }
    return known


def _states_again(statement: Statement, lens: Mapping[str, float]) -> bool:
    """Whether it states one coefficient of a lens under its own name, or several, and nothing else."""
    values = [slot.value for slot in statement.slots if slot.value]
    if len(values) == 1:
        name = _NAMED.fullmatch(_SEPARATORS.sub("", statement.path[-1]).lower())
        return name is not None and _is_nearly(values[0], lens.get(name[1], 0.0))
    left = list(lens.values())
    for value in values:
        same = next((one for one in left if _is_nearly(value, one)), None)
        if same is None:
            return False
        left.remove(same)
    return len({*values}) > 1


def _is_nearly(stated: float | str, read: float) -> bool:
    """Whether two numbers are the same but for the digits that one of them was printed with."""
    return (
        isinstance(stated, float) and bool(read) and math.isclose(stated, read, rel_tol=1e-6, abs_tol=PRINTED)
    )


def _only_lens(cameras: Sequence[Calibration]) -> Mapping[str, float]:
    """The coefficients of the lens of all cameras; none if they differ, as a camera's would be another's again."""
    first = cameras[0].distortion if cameras else None
    is_only = first is not None and all(item.distortion == first for item in cameras)
    return first.coefficients if first is not None and is_only else {}


def _numbers_of(item: Calibration) -> Calibration:
    return replace(item, notes=(), extras=())


class _Lines:
    """A text whose lines of keys and values can be changed: by number, the values."""

    def __init__(self, data: bytes) -> None:
        self.encoding = "utf-16" if data[:2] in {b"\xff\xfe", b"\xfe\xff"} else "latin-1"
        text = data.decode(self.encoding, "replace")
        self.parts: list[str] = []
        self.keys: list[tuple[str, int]] = []
        at = 0
        for match in _LINE.finditer(text, 0, HEAD):
            self.keys.append((match[1], len(self.parts) + 1))
            self.parts += [text[at : match.start(2)], match[2]]
            at = match.end(2)
        self.parts.append(text[at:])

    def __getitem__(self, index: int) -> str:
        return self.parts[index]

    def __setitem__(self, index: int, value: Any) -> None:
        self.parts[index] = value

    def data(self) -> bytes:
        return "".join(self.parts).encode(self.encoding)


class _Kind(Struct, frozen=True):
    """What a key could be: of one coefficient, of several, of a model, a misspelt coefficient, beside K but no lens."""

    scalar: bool
    vector: bool
    model: bool
    short: bool
    table: bool
    beside: bool


NOTHING = _Kind(scalar=False, vector=False, model=False, short=False, table=False, beside=False)
ASIDE = replace(NOTHING, beside=True)


def _statements_of(
    document: object, focals: set[float], aside: set[int], *, is_bare: bool
) -> list[Statement]:
    """The statements of a document that could be geometry.

    Args:
        document: a tree, an XML document or a text.
        focals: focal lengths of the cameras, px, to know K by.
        aside: identities of the containers that are passed over.
        is_bare: whether a camera has no lens, so that an unnamed vector beside K could be it.
    """
    found: list[Statement] = []
    vectors: list[Statement] = []
    short: list[Statement] = []
    near_K: set[tuple[str, ...]] = set()
    near_lens: set[tuple[str, ...]] = set()
    for path, kind, in_a_lens, slots in _entries(document, aside, is_bare=is_bare):
        values = [slot.value for slot in slots]
        first = values[0]
        if isinstance(first, str):
            if (kind.model or kind.vector) and names.LENS.search(first):
                found.append(Statement(path, tuple(slots)))
            continue
        if is_bare and not focals.isdisjoint(values):
            near_K.update(path[:depth] for depth in range(max(0, len(path) - REACH), len(path)))
            continue
        list_of_it = _standing(kind, len(values), in_a_lens=in_a_lens, is_bare=is_bare)
        numbers = [value for value in values if isinstance(value, float)] if list_of_it else []
        if not any(value % 1 for value in numbers):  # all whole: zeros, flags, counts, an area
            continue
        near_lens.update({path[:-1]} if list_of_it == OF_A_LENS else ())
        if max(map(abs, numbers)) < LARGEST and (list_of_it != UNNAMED or _could_be_a_lens(numbers)):
            one = Statement(path, tuple(slot for slot in slots if slot.value))
            {OF_A_LENS: found, MISSPELT: short, UNNAMED: vectors}[list_of_it].append(one)
    found += [one for one in short if one.path[:-1] in near_lens]
    return found + [one for one in vectors if one.path[:-1] in near_K]


def _standing(kind: _Kind, count: int, *, in_a_lens: bool, is_bare: bool) -> str:
    """What so many numbers could be by their key; nothing for what is no lens."""
    if in_a_lens or (kind.scalar if count == 1 else kind.vector):
        return OF_A_LENS
    if kind.short and count == 1:
        return MISSPELT
    return UNNAMED if is_bare and count in VECTOR and not kind.beside else ""


def _entries(
    document: object, aside: set[int], *, is_bare: bool
) -> Iterator[tuple[tuple[str, ...], _Kind, bool, list[_Slot]]]:
    """Every number, text and vector that matters: its keys, whether one above names a lens, its places."""
    if isinstance(document, _Lines):
        for key, index in document.keys:
            kind = _kind_of(key)
            if kind is not None and (slots := _slots(document, index)):
                yield (key,), kind, False, slots
        return
    root = document.value if isinstance(document, Node) else getattr(document, "tree", document)
    todo: deque[tuple[Any, tuple[str, ...], _Kind, bool]] = deque([(root, (), NOTHING, False)])
    left = MOST_NODES
    while todo and left > 0:
        holder, path, kind, in_a_lens = todo.popleft()
        for key, name, value in _children(holder):
            left -= 1
            deeper, own = (path, kind) if name is None else ((*path, name), _kind_of(name))
            if own is None or id(value) in aside:
                continue
            found = _places(holder, key, value, own, is_wanted=is_bare or in_a_lens)
            if found is None:
                todo.append((value, deeper, own, in_a_lens or (name is not None and own.table)))
            elif found and deeper:
                yield deeper, own, in_a_lens, found


def _places(holder: Any, key: Any, value: Any, kind: _Kind, *, is_wanted: bool) -> list[_Slot] | None:
    """The places of a number, a text or a vector, none if it does not matter; None for a container of others."""
    if isinstance(value, int | float | str):
        matters = is_wanted or kind.scalar or kind.vector or kind.model or kind.short
        return _slots(holder, key) if matters else []
    if (
        kind.beside
        and isinstance(value, list)
        and not kind.vector
        and not (value and isinstance(value[0], dict))
    ):
        return []
    return _vector(value)


def _children(holder: Any) -> Iterator[tuple[Any, str | None, Any]]:
    """What a container holds: its key, its name, its value. Of an element its attributes, text and elements."""
    if isinstance(holder, dict):
        yield from ((key, key, holder[key]) for key in _some(list(holder)))
    elif isinstance(holder, list):
        yield from ((index, None, holder[index]) for index in _some(range(len(holder))))
    elif holder is not None:
        yield from ((key, key.rpartition("}")[2], text) for key, text in holder.items())
        children = list(holder)
        if not children and holder.text:
            yield None, None, holder.text
        for child in _some(children):
            yield None, str(child.tag).rpartition("}")[2], child


def _some(items: Sequence[Any]) -> Sequence[Any]:
    return items if len(items) <= LONG else [*items[: LONG // 2], *items[-LONG // 2 :]]


def _vector(value: Any) -> list[_Slot] | None:
    """The places of a short vector or matrix, none of a long one; None for another container."""
    if isinstance(value, dict):
        is_matrix = "data" in value and len(value.keys() & {"rows", "cols", "sizes", "dt"}) > 1
        return _vector(value["data"]) if is_matrix and isinstance(value["data"], list) else None
    if not isinstance(value, list):
        return [] if value is None else None
    if value and all(isinstance(item, list) for item in value[:LONG]):
        rows = [_vector(row) for row in value[:LONG]]
        slots = [slot for row in rows if row for slot in row]
        return None if None in rows else slots if len(slots) <= LONGEST_VECTOR else []
    if len(value) > LONGEST_VECTOR:
        return None if isinstance(value[0], dict | list) else []
    if any(isinstance(item, dict | list) for item in value):
        return None
    return [slot for index in range(len(value)) for slot in _slots(value, index)]


def _slots(holder: Any, key: Any) -> list[_Slot]:
    """The place of a number or a text, or the places of the numbers in a text of nothing else."""
    raw = _content(holder, key)
    if isinstance(raw, float):
        return [_Slot(holder, key, raw)]
    if isinstance(raw, bool) or raw is None:
        return []
    if isinstance(raw, int):
        return [_Slot(holder, key, float(raw))]
    if not isinstance(raw, str):
        return [_Slot(holder, key, "")]
    if raw[:1] in _BEGINS_A_NUMBER and len(raw) < LONGEST_TEXT and _ALL_NUMBERS.fullmatch(raw):
        return [_Slot(holder, key, float(match[0]), match.span()) for match in _NUMBERS.finditer(raw)]
    return [_Slot(holder, key, raw.strip())]


@lru_cache(maxsize=4096)
def _kind_of(key: str) -> _Kind | None:
    """What a key could be; None for one of what is said about coefficients, and for what is none."""
    simple = _SEPARATORS.sub("", key).lower()
    if _OF_SOMETHING_ELSE.fullmatch(simple):
        return None
    words = _WORD.findall(key)
    if words and _ERRORS.fullmatch(words[-1].lower()):
        return None
    if any(_ABOUT_NUMBERS.fullmatch(word.lower()) for word in words):
        return ASIDE if len(words) > 1 and not _ABOUT_WHAT.search(simple) else None
    return _Kind(
        scalar=bool(_LENS.search(simple) or _COEFFICIENT.search(key)),
        vector=bool(_OF_A_LENS.search(simple) or _VECTOR_OF_A_LENS.fullmatch(simple)),
        model=bool(_MODEL_KEY.search(simple)),
        short=bool(_SHORT.fullmatch(simple)),
        table=bool(_TABLE_OF_A_LENS.search(simple)),
        beside=bool(_BESIDE.search(simple)),
    )


def _could_be_a_lens(values: Sequence[float]) -> bool:
    """Whether a vector is not a rotation, a quaternion, a pose, a camera matrix or a projection."""
    numbers = np.array(values)
    if np.abs(numbers).max() > LARGEST:
        return False
    if len(values) in {9, 12} and np.array_equal(numbers.reshape(3, -1)[2, :3], [0.0, 0.0, 1.0]):
        return False
    rows = numbers.reshape(3, -1)[:, :3] if len(values) in {9, 12} else numbers[None, :4]
    return bool(np.abs(np.square(rows).sum(axis=1) - 1).max() > TURNED)
