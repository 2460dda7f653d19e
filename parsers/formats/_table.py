"""Formats that are a K and a lens under a program's own names: what a row of their table says, and how it is read.

The rows are in :data:`FILES`, by the kind of program. A row names where its numbers
stand by paths: ``intrinsics.fx``, ``params[4:8]``, and ``cam_fx|A11`` for the first of two that is there. A file
without names is made a document by the row's ``load``. A format that needs more than that is a module of its own.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import TYPE_CHECKING, TypeAlias

from msgspec import Struct, field

from calibrary.calibration import Calibration, Grade, ImageSize
from calibrary.distortion import Distortion, NoDistortion
from calibrary.errors import InputError, ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native
from calibrary.parsers.document import Node, accounted
from calibrary.parsers.format import Capacity, Format, Option, ReadContext, Sniff, Sure, Write
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._lenses import taylor_lens, upper_triangle
from calibrary.parsers.formats._one_camera import ORIGIN, camera, chosen_origin, native_of, refuse_model
from calibrary.parsers.formats._text_rows import text_of
from calibrary.parsers.formats._tree import MAX_BYTES
from calibrary.parsers.xml import parse_xml
from calibrary.records import Json, replace

if TYPE_CHECKING:
    from lxml.etree import _Element

FILES = ("_aerial", "_devices", "_scenes", "_slam", "_toolboxes")
"""Modules with the rows of photogrammetry, of cameras' makers, of scenes and data sets, of SLAM, of calibrating."""
SYNTAXES = {
    ".json": Syntax.JSON,
    ".xml": Syntax.XML,
    ".npy": Syntax.BINARY,
    ".npz": Syntax.BINARY,
    ".dat": Syntax.BINARY,
}
"""Of the usual suffixes; all others are of text."""
MOST_BYTES = 64 * 1024
"""Of a text with one camera; a hundred times what it contains."""
MOST_CAMERAS = 1000
K4 = ("fx", "fy", "cx", "cy")
OF_RAY = ("ray.fx", "ray.fy", "ray.cx", "ray.cy", "ray.skew")
FOUR = "a fisheye's four are k1, k2, k3, k4"
WITH_SKEW = 5
ANY = "*"
"""The first of a table, whatever its key."""

_STEP = re.compile(r"([^.\[\]]+)|\[(\d*)(:?)(\d*)\]")
_BETWEEN = re.compile(r"[\[\](),;\s]+")
_FIRST_WORD = re.compile(r"[\s\-{\"']*([\w.]+)[\"']?\s*[:=]")

Named: TypeAlias = Iterator[tuple[str | None, Node]]
"""Cameras of a document, each with its name."""


class Mark(Struct, frozen=True):
    """What a file of the format has.

    Attributes:
        keys: names in it, all of which are there: keys of a table of JSON, top keys of YAML or TOML, tags of XML.
        at: path of that table, in JSON.
        holds: what is true of that table.
        inner: names at the beginning of lines of a text.
        words: what its text contains as well.
        sure: how certain that makes it.
    """

    keys: tuple[str, ...]
    at: str = ""
    holds: Callable[[Node], bool] = lambda _: True
    inner: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    sure: Sure = Sure.MAGIC


class Model(Struct, frozen=True):
    """A camera model as the format states it.

    Attributes:
        lens: makes the lens of the coefficients.
        numbers: paths of the coefficients, in the order of ``lens``; one may be of several.
        counts: how many there are; empty if their paths or ``lens`` say so.
        missing: what a coefficient is that a file leaves out; None if it has to be there.
        K: as for the format, if it is another.
        convention: if it is another than the format's.
    """

    lens: Callable[[Sequence[float]], Distortion | None] = lambda _: NoDistortion()
    numbers: tuple[str, ...] = ()
    counts: tuple[int, ...] = ()
    missing: float | None = None
    K: str | tuple[str, ...] = ()
    convention: Convention | None = None


UNKNOWN_LENS = {"": Model(lambda _: None)}


class Program(Struct, frozen=True, kw_only=True):
    """A row: a format of a program.

    Attributes:
        name, title, suffixes, roots, reference, convention, options, idle: as in
            :class:`~calibrary.parsers.format.Format`.
        syntaxes: if they are not those of the suffixes.
        words: the format in its own words, and the source.
        marks: any of which a file has.
        recognise: recognises a file without names, in place of the marks.
        load: makes the document of a file without names, or without a syntax.
        cameras: its cameras with their names, in a document.
        K: path of the matrix, or paths of fx, fy, cx, cy and perhaps the skew.
        is_transposed: whether the matrix runs down its columns.
        asks_origin: whether the file does not say where its principal point counts from, and the caller may.
        size: paths of width and height, or of both; empty if no file states it.
        model: paths of the model's name, whose parts are put together.
        models: the models by their names; under the empty name what a file without a name has.
        grade: of K.
        assumptions: what is assumed of every file.
        is_always_named: whether a camera has its name also where it is alone.
        is_of_images: whether cameras stand once for each image, so that equal ones are one.
        most: cameras that are read.
        finish: adds what else the file states of a camera, from the document and the camera's table.
        write, capacity, states: as in :class:`~calibrary.parsers.format.Format`.
    """

    name: str
    title: str
    words: str
    suffixes: tuple[str, ...]
    syntaxes: tuple[Syntax, ...] = ()
    reference: str
    convention: Convention
    marks: tuple[Mark, ...] = ()
    recognise: Callable[[Content], Sniff | None] | None = None
    load: Callable[[bytes, ReadContext], Node] | None = None
    roots: tuple[str, ...] = ()
    cameras: Callable[[Node, ReadContext], Named] = field(default_factory=lambda: whole)
    K: str | tuple[str, ...]
    is_transposed: bool = False
    asks_origin: bool = False
    size: tuple[str, ...] = ("width", "height")
    model: tuple[str, ...] = ()
    models: Mapping[str, Model] = field(default_factory=lambda: {"": Model()})
    grade: Grade = Grade.CALIBRATED
    assumptions: tuple[str, ...] = ()
    is_always_named: bool = False
    is_of_images: bool = False
    most: int = MOST_CAMERAS
    options: tuple[Option, ...] = ()
    idle: tuple[str, ...] = ()
    finish: Callable[[Node, Node, Calibration], Calibration] = lambda _tree, _node, item: item
    write: Write | None = None
    capacity: Capacity | None = None
    states: tuple[str, ...] = ()

    def format(self) -> Format:
        """The format that reads the files of this row."""
        return Format(
            name=self.name,
            title=self.title,
            words=self.words,
            suffixes=self.suffixes,
            syntaxes=self.syntaxes or tuple({SYNTAXES.get(one, Syntax.TEXT) for one in self.suffixes}),
            roots=self.roots,
            reference=self.reference,
            convention=self.convention,
            sniff=self.recognise or partial(_sniff, self),
            read=partial(_read, self),
            needs_image_size=not self.size,
            options=(*self.options, *((ORIGIN,) if self.asks_origin else ())),
            idle=self.idle,
            write=self.write,
            capacity=self.capacity,
            states=self.states,
        )


def whole(tree: Node, _context: ReadContext) -> Named:
    """The document is the one camera."""
    yield None, tree


def listed(path: str, name: str = "", *, inside: str = "") -> Callable[[Node, ReadContext], Named]:
    """The cameras of a list, or of a table by their keys.

    Args:
        path: of the list.
        name: path of the name in an item; empty for cam0, cam1 …
        inside: path of the camera in an item.
    """

    def cameras(tree: Node, _context: ReadContext) -> Named:
        table = at(tree, path)
        if isinstance(table.value, dict):
            yield from ((key, at(node, inside)) for key, node in table.entries())
            return
        for index, item in enumerate(table.items()):
            yield str(at(item, name).value) if name else f"cam{index}", at(item, inside)

    return cameras


def with_more(node: Node, more: dict[str, Json]) -> Node:
    """A table with more in it."""
    own = node.value if isinstance(node.value, dict) else {}
    return Node({**own, **more}, source=node.source, place=node.place)


def under(table: str, keys: str) -> tuple[str, ...]:
    """Paths of some keys of a table."""
    return tuple(f"{table}.{key}" for key in keys.split())


def with_rest(item: Calibration, node: Node, prefix: str, own: Collection[str]) -> Calibration:
    """With the other keys of its table, as JSON."""
    rest = ((key, child.value) for key, child in node.entries() if key not in own)
    return replace(
        item, extras=tuple((prefix + key, json.dumps(value, ensure_ascii=False)) for key, value in rest)
    )


def rest_of(item: Calibration, prefix: str) -> dict[str, str]:
    """What :func:`with_rest` kept, by its keys."""
    return {key.removeprefix(prefix): text for key, text in item.extras if key.startswith(prefix)}


def document_of(context: ReadContext, /, **values: Json) -> Node:
    """The document of a file without names."""
    return Node(values, source=context.name)


def numbers_of(lines: Sequence[str]) -> list[tuple[float, ...]] | None:
    """The numbers of each line; None if there is anything else."""
    try:
        return [strict.numbers(line) for line in lines]
    except ParseError:
        return None


def taylor(values: Sequence[float]) -> Distortion:
    """The lens of a ray's polynomial of the radius in px."""
    return taylor_lens(values, place="")[0]


def with_turn(node: Node, terms: Node, affine: Sequence[float], centre: Sequence[float], place: str) -> Node:
    """A camera of a ray's polynomial and of the matrix s·(1 e; d c), with K and the angle to its frame."""
    _, f = taylor_lens(terms.numbers(), place=terms.place or "")
    s, c, d, e = affine
    fx, skew, fy, turn = upper_triangle(f * s, c, d, e, place=place)
    cx, cy = centre
    return with_more(node, {"ray": {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "skew": skew, "turn": turn}})


def turned(node: Node, item: Calibration, whose: str) -> Calibration:
    """With the note that the camera's frame is turned, where it is."""
    found = find(node, "ray.turn")
    if found is None or not found.number():
        return item
    angle = math.degrees(found.number())
    return noted(item, f"the camera's frame is turned about its axis by {angle:.4f}° against {whose}")


def noted(item: Calibration, *notes: str) -> Calibration:
    """With more notes."""
    return replace(item, notes=(*item.notes, *notes))


def at(node: Node, path: str) -> Node:
    """The value at a path.

    Raises:
        ParseError: there is none; of several paths, the message is of the first.
    """
    found = find(node, path) or _followed(node, path.partition("|")[0], is_needed=True)
    return found or node


def everywhere(node: Node, wanted: str) -> Iterator[Node]:
    """Every element of a name, wherever it is; several of one name are a list."""
    for key, inner in node.entries() if isinstance(node.value, dict) else ():
        for one in inner.items() if isinstance(inner.value, list) else (inner,):
            yield from (one,) if key == wanted else everywhere(one, wanted)


def find(node: Node, path: str) -> Node | None:
    """The value at a path, None if there is none or if it is null."""
    every = (_followed(node, one, is_needed=False) for one in path.split("|"))
    return next((found for found in every if found is not None and found.value is not None), None)


def _followed(node: Node, path: str, *, is_needed: bool) -> Node | None:
    for step, first, colon, last in _steps(path):
        value = node.value
        key = next(iter(value), ANY) if step == ANY and isinstance(value, dict) else step
        if key and (is_needed or (isinstance(value, dict) and key in value)):
            node = node[key]
        elif colon:
            part: list[Json] = [*_all_numbers(node)[int(first or 0) : int(last) if last else None]]
            node = Node(part, source=node.source, place=f"{node.place}[{first}:{last}]")
        elif first and isinstance(value, list) and int(first) < len(value):
            node = Node(value[int(first)], source=node.source, place=f"{node.place or ''}[{first}]")
        elif is_needed:
            node.fail(f"expected a list of more than {first} items")
        else:
            return None
    return node


@lru_cache(maxsize=512)
def _steps(path: str) -> tuple[tuple[str, str, str, str], ...]:
    return tuple(_STEP.findall(path))


def numbers_at(node: Node, paths: Iterable[str], missing: float | None = None) -> list[float]:
    """The numbers at some paths, in order."""
    found: list[float] = []
    for path in paths:
        if missing is not None and all(find(node, one) is None for one in path.split("|")):
            found.append(missing)
            continue
        place = at(node, path)
        found += storage.numbers(place) if isinstance(place.value, list | dict) else [place.number()]
    return found


def one_each(node: Node, paths: Iterable[str], missing: float | None = None) -> list[float]:
    """One number at each path, in order."""
    return [
        missing if missing is not None and find(node, path) is None else at(node, path).number()
        for path in paths
    ]


def _all_numbers(node: Node) -> Sequence[float]:
    """Those of a list, a matrix, or a text with several."""
    if not isinstance(node.value, str):
        return storage.numbers(node)
    words = _BETWEEN.sub(" ", node.value).strip()
    return strict.numbers(words, count=len(words.split()), source=node.source, place=node.place)


def _sniff(row: Program, content: Content) -> Sniff | None:
    """The first of the marks that the file has."""
    for mark in row.marks:
        if not _has(content, mark) or not all(word in (content.text or "") for word in mark.words):
            continue
        if not mark.inner or set(mark.inner) <= _first_words(content):
            under = f" under {mark.at}" if mark.at else ""
            return Sniff(mark.sure, f"the names {', '.join((*mark.keys, *mark.inner, *mark.words))}{under}")
    return None


def _first_words(content: Content) -> set[str]:
    return {match[1] for line in content.lines if (match := _FIRST_WORD.match(line))}


def _has(content: Content, mark: Mark) -> bool:
    if not mark.at and not content.names.issuperset(mark.keys):
        return False
    if content.syntax is not Syntax.JSON:
        return not mark.at
    table = find(Node(content.json, source=content.name), mark.at)
    is_there = table is not None and isinstance(table.value, dict) and table.value.keys() >= {*mark.keys}
    return is_there and table is not None and mark.holds(table)


def _read(row: Program, data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the file's order."""
    tree = _loaded(row, data, context) if row.load is None else row.load(data, context)
    named = []
    for pair in row.cameras(tree, context):
        named.append(pair)
        if len(named) > row.most:
            tree.fail(f"there are over {row.most} cameras, the most that are read")
    found = [_camera(row, name, node, context, tree) for name, node in named]
    if row.is_of_images:
        first: dict[object, Calibration] = {}
        for item in found:
            first.setdefault((item.intrinsics, item.distortion), item)
        found = list(first.values())
    if len(found) > 1 or row.is_always_named:
        return found
    return [replace(item, camera=replace(item.camera, sub_camera=None)) for item in found]


def _loaded(row: Program, data: bytes, context: ReadContext) -> Node:
    head = data[:256].lstrip(b"\xef\xbb\xbf \t\r\n")
    if head.startswith(b"{") or ".json" in row.suffixes:
        return loaded(data, context)
    if ".toml" in row.suffixes:
        return _of_toml(data, context.name)
    if head.startswith(b"<") and "opencv_storage" not in row.roots:
        return _of_xml(data, context.name)
    return storage.load(data, source=context.name)


@accounted
def _of_toml(data: bytes, source: str) -> Node:
    text = text_of(data, most=MAX_BYTES)
    try:
        return Node(tomllib.loads(text.replace("\r\n", "\n")), source=source)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        raise ParseError(f"this is not TOML: {strict.shown(str(error), 80)}", source=source) from None


@accounted
def _of_xml(data: bytes, source: str) -> Node:
    root = parse_xml(data, source=source, max_bytes=MAX_BYTES)
    return Node({str(root.tag): _of_element(root)}, source=source)


def _of_element(element: _Element) -> Json:
    """Attributes and children by name, several of one name as a list; without either the text."""
    table: dict[str, Json] = {str(key): str(value) for key, value in element.attrib.items()}
    children: dict[str, list[Json]] = {}
    for child in element:
        children.setdefault(str(child.tag), []).append(_of_element(child))
    for key, values in children.items():
        table[key] = values[0] if len(values) == 1 else values
    return table or (element.text or "").strip()


def _camera(row: Program, name: str | None, node: Node, context: ReadContext, tree: Node) -> Calibration:
    model = _model(row, node)
    native = _native(row, model.K or row.K, node)
    values = numbers_at(node, model.numbers, model.missing)
    place = (find(node, model.numbers[0]) if len(model.numbers) == 1 else None) or node
    if model.counts:
        strict.check_count(len(values), model.counts, place=place.place)
    try:
        lens = model.lens(values)
    except InputError as error:
        raise type(error)(error.message, place=error.place or place.place) from None
    except (ValueError, IndexError):
        raise ParseError(
            f"{len(values)} coefficients, which the lens does not have", place=place.place
        ) from None
    convention, assumptions = model.convention or row.convention, row.assumptions
    if row.asks_origin:
        origin, sentence = chosen_origin(context, convention.origin)
        convention, assumptions = replace(convention, origin=origin), (*assumptions, sentence)
    size = _size(row, node)
    item = camera(
        context, convention, native, size, lens, name=name, tag=node.place or name, assumptions=assumptions
    )
    return row.finish(tree, node, replace(item, grade=row.grade))


def _model(row: Program, node: Node) -> Model:
    named = [find(node, path) for path in row.model]
    word = " ".join(str(one.value) for one in named if one is not None)
    models = {name.lower(): model for name, model in row.models.items()}
    if word.lower() not in models:
        places = [at(node, path).place for path in row.model]
        refuse_model(word, tuple(filter(None, row.models)), place=places[-1])
    return models[word.lower()]


def _native(row: Program, paths: str | Sequence[str], node: Node) -> Native:
    if isinstance(paths, str):
        return native_of(at(node, paths), transposed=row.is_transposed)
    numbers = numbers_at(node, paths)
    count = WITH_SKEW if len(paths) == WITH_SKEW else WITH_SKEW - 1
    strict.check_count(len(numbers), count, place=at(node, paths[0]).place)
    return Native(**dict(zip(("fx", "fy", "cx", "cy", "skew"), numbers, strict=False)))


def _size(row: Program, node: Node) -> ImageSize | None:
    """The image size; None if the file does not state it."""
    if all(find(node, path) is None for path in row.size):
        return None
    numbers, place = numbers_at(node, row.size), at(node, row.size[0]).place
    strict.check_count(len(numbers), 2, place=place)
    return strict.image_size(*numbers, place=place)
