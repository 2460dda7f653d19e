"""COLMAP's cameras of a reconstruction: its text file and its binary file."""

from __future__ import annotations

import math
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from types import MappingProxyType
from typing import Final, NamedTuple, TypeVar, cast, overload

from calibrary.arrays import ArrayLike, BoolArray, NDArray, np
from calibrary.calibration import Calibration, Grade, ImageSize, Intrinsics, Origin
from calibrary.distortion import Distortion, FieldOfView, NoDistortion
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.interop.colmap import (
    COLMAP_LENSES,
    COLMAP_MODELS,
    PANORAMAS,
    ColmapCamera,
    ColmapModel,
    default_model,
    lens_from,
    model_for,
    model_named,
)
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.on_demand import FEW, CamerasOnDemand, Columns, make_a_camera
from calibrary.records import Record, force_setattr

R = TypeVar("R", bound=Record)

CONVENTION: Final = Convention(
    origin=Origin.CORNER,
    remarks=(
        "one or two focal lengths, the principal point, and then the coefficients, as the camera's model has them",
        "p0 and p1 of RAD_TAN_THIN_PRISM_FISHEYE are OpenCV's p2 and p1",
    ),
)
CAPACITY: Final = Capacity(models=COLMAP_LENSES, several_cameras=True, unknown_lens=UnknownLens.FREE)

MAX_CAMERAS = 1_000_000
"""Most cameras in a file: one for every image of the largest collections."""

CAMERA_ID = "colmap/camera_id"
MODEL = "colmap/model"
SERIES_BELOW = 0.01


class StoredCamera(NamedTuple):
    """One camera as COLMAP stores it.

    Attributes:
        number: camera id.
        model: the model, or its name if it has no K.
        width, height: px.
        parameters: in COLMAP's order.
        place: in the file, for messages.
    """

    number: int
    model: ColmapModel | str
    width: int
    height: int
    parameters: tuple[float, ...]
    place: str


class StoredColumns(Sequence[StoredCamera]):
    """Cameras of one model as columns.

    Attributes:
        columns: their numbers.
    """

    def __init__(
        self,
        model: ColmapModel,
        ids: ArrayLike,
        sizes: ArrayLike,
        parameters: ArrayLike,
        place: str = "",
        first: int = 1,
    ) -> None:
        """Store the columns: (N,), (N, 2) and (N, count).

        ``place`` is that of a camera in the file, with {} for its number, counted from ``first``.
        """
        numbers = np.asarray(parameters, dtype=np.float64)
        self.columns = Columns(
            model=model,
            ids=np.asarray(ids, dtype=np.int64),
            sizes=np.asarray(sizes, dtype=np.int64),
            K=numbers[:, [0, model.focals - 1, model.focals, model.focals + 1]],
            coefficients=numbers[:, model.focals + 2 :],
        )
        self._model = model
        self._parameters = numbers
        self._place, self._first = place, first

    def __len__(self) -> int:
        return len(self.columns.ids)

    @overload
    def __getitem__(self, index: int) -> StoredCamera: ...
    @overload
    def __getitem__(self, index: slice) -> list[StoredCamera]: ...

    def __getitem__(self, index: int | slice) -> StoredCamera | list[StoredCamera]:
        if isinstance(index, slice):
            return [self[at] for at in range(len(self))[index]]
        width, height = self.columns.sizes[index].tolist()
        return StoredCamera(
            int(self.columns.ids[index]),
            self._model,
            width,
            height,
            tuple(self._parameters[index].tolist()),
            self._place.format(index + self._first),
        )


def cameras(found: Sequence[StoredCamera], context: ReadContext, *, grade: Grade) -> Sequence[Calibration]:
    """All cameras with a K, in order; a note names the others.

    Raises:
        ParseError: two cameras have the same id, or a camera's numbers are invalid.
        UnsupportedModelError: no camera has a K.
    """
    columns = found.columns if isinstance(found, StoredColumns) else None
    ids = [item.number for item in found] if columns is None else columns.ids.tolist()
    if len(set(ids)) < len(ids):
        [(twice, _), *_] = Counter(ids).most_common(1)
        raise ParseError(f"there are two cameras {twice}")
    left_out: tuple[str, ...] = ()
    if columns is None:
        without = [f"camera {item.number} is {item.model}" for item in found if isinstance(item.model, str)]
        if without and len(without) == len(found):
            raise UnsupportedModelError(
                f"{without[0]}, which has no K; cut perspective views from its images"
            )
        left_out = (f"left out, for want of a K: {', '.join(without[:20])}",) if without else ()
        with_k: Sequence[StoredCamera] = [item for item in found if not isinstance(item.model, str)]
    else:
        with_k = found

    make = partial(_calibration, with_k, context=context, several=len(ids) > 1, grade=grade, notes=left_out)
    if len(with_k) < FEW:
        return [make(place) for place in range(len(with_k))]
    if context.image_size is not None:
        # The caller's image size may contradict that of the file.
        sure, columns = np.zeros(len(with_k), dtype=np.bool_), None
    else:
        sure = _sure(with_k) if columns is None else _certain(columns)
    return CamerasOnDemand(sure, _Alike(with_k, make, sure.tolist()), columns)


class _Alike:
    """Makes cameras, those that are certainly valid as copies of one like them with their own numbers.

    A copy has no number checked again, and takes a tenth of the time. Two are alike if they are of one model, with one
    focal length or two, and the same coefficients are zero: then they have one lens model here, and the same extras.
    """

    def __init__(
        self,
        found: Sequence[StoredCamera],
        make: Callable[[int], Calibration],
        sure: Sequence[bool],
    ) -> None:
        self._found, self._make, self._sure = found, make, sure
        self._first: dict[tuple[object, ...], Calibration] = {}

    def __call__(self, place: int) -> Calibration:
        """The camera at a place."""
        if not self._sure[place]:
            return self._make(place)
        item = self._found[place]
        model = cast("ColmapModel", item.model)
        parameters, centre = item.parameters, model.focals
        coefficients = parameters[centre + 2 :]
        fx, fy = parameters[0], parameters[centre - 1]
        key = (model.number, fx == fy, *map(bool, coefficients))
        first = self._first.get(key)
        if first is None:
            return self._first.setdefault(key, self._make(place))
        size = item.width, item.height
        lens = first.distortion or NoDistortion()
        stated = zip(model.coefficients, coefficients, strict=True)
        own = {name: value for name, value in stated if name in lens.__struct_fields__}
        camera: dict[str, object] = {"image_size": size}
        if first.camera.sub_camera is not None:
            camera["sub_camera"] = str(item.number)
        K = {"fx": fx, "fy": fy, "cx": parameters[centre], "cy": parameters[centre + 1], "image_size": size}
        return _copied(
            first,
            {
                "camera": _copied(first.camera, camera),
                "intrinsics": _copied(first.intrinsics, K),
                "distortion": _copied(lens, own),
                "provenance": _copied(first.provenance, {"tag": f"camera {item.number}"}),
            },
        )


def _copied(value: R, fields: Mapping[str, object]) -> R:
    """A copy of a record with other values, which are not checked."""
    made: R = value.__copy__()  # type: ignore[attr-defined]  # not in msgspec's stub
    for name, own in fields.items():
        force_setattr(made, name, own)
    return made


def _sure(found: Sequence[StoredCamera]) -> BoolArray:
    """Mask (N,) of the cameras that are certainly valid, so that they need not be made for checking."""
    sure = np.zeros(len(found), dtype=bool)
    # Grouped by number, because hashing a whole model takes most of the time.
    kinds: dict[int, list[int]] = {}
    for place, item in enumerate(found):
        if not isinstance(item.model, str):
            kinds.setdefault(item.model.number, []).append(place)
    for places in kinds.values():
        stored, model = [found[place] for place in places], found[places[0]].model
        if isinstance(model, str) or {len(item.parameters) for item in stored} != {model.count}:
            continue
        # A flat iterator, because NumPy takes three times as long for a list of tuples.
        every = chain.from_iterable(item.parameters for item in stored)
        numbers = np.fromiter(every, np.float64, len(stored) * model.count).reshape(-1, model.count)
        # A hostile size need not fit into 64 bits.
        sizes = [[min(side, strict.LONGEST_SIDE_PX + 1) for side in item[2:4]] for item in stored]
        sure[places] = _certain(StoredColumns(model, np.zeros(len(stored)), sizes, numbers).columns)
    return sure


def _certain(columns: Columns) -> BoolArray:
    """The same of cameras of one model."""
    model, sizes = columns.model, columns.sizes
    if not isinstance(model, ColmapModel) or model.lens.__post_init__ is not Distortion.__post_init__:
        return np.zeros(len(sizes), dtype=bool)
    numbers = np.concatenate([columns.K, columns.coefficients], axis=1)
    good = make_a_camera(columns.K[:, :2], columns.K[:, 2:], numbers, sizes.max(axis=1))
    return good & (sizes >= 1).all(axis=1) & (sizes <= strict.LONGEST_SIDE_PX).all(axis=1)


def records(calibrations: Sequence[Calibration]) -> Iterator[tuple[int, ColmapCamera]]:
    """Yield each camera with its id; ids from COLMAP are kept if they are distinct."""
    kept = [dict(item.extras).get(CAMERA_ID) or item.camera.sub_camera or "" for item in calibrations]
    keep = all(text.isdecimal() and int(text) < 1 << 32 for text in kept) and len(set(kept)) == len(kept)
    for index, item in enumerate(calibrations):
        yield int(kept[index]) if keep else index + 1, item.to_colmap(dict(item.extras).get(MODEL))


def _calibration(
    found: Sequence[StoredCamera],
    place: int,
    *,
    context: ReadContext,
    several: bool,
    grade: Grade,
    notes: tuple[str, ...],
) -> Calibration:
    item = found[place]
    model = cast("ColmapModel", item.model)
    size = context.size(strict.image_size(item.width, item.height, place=item.place))
    try:
        intrinsics, distortion = _k_and_lens(model, item.parameters, size)
    except InputError as error:
        raise ParseError(error.message, place=item.place) from None
    extras = ((CAMERA_ID, str(item.number)),) if not several and item.number != 1 else ()
    if default_model(type(distortion)) is not model:
        simplest, _ = model_for(distortion, one_focal=intrinsics.fx == intrinsics.fy)
        extras = (*extras, (MODEL, model.name)) if simplest is not model else extras
    return context.calibration(
        intrinsics,
        distortion,
        name=str(item.number) if several else None,
        tag=f"camera {item.number}",
        grade=grade,
        notes=(*notes, *_series(distortion)),
        extras=extras,
    )


def _k_and_lens(
    model: ColmapModel, parameters: Sequence[float], size: ImageSize
) -> tuple[Intrinsics, Distortion]:
    """Convert all parameters of a COLMAP model, in COLMAP's order, to K and a lens.

    Raises:
        InputError: the count is wrong, a parameter is not finite, or K or the lens is invalid.
    """
    if len(parameters) != model.count:
        raise InputError(f"{model.name} with {len(parameters)} parameters, expected {model.count}")
    if not all(map(math.isfinite, parameters)):
        raise InputError("a parameter is not finite")
    fx, fy = parameters[0], parameters[model.focals - 1]
    cx, cy = parameters[model.focals : model.focals + 2]
    intrinsics = Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, image_size=size)
    return intrinsics, lens_from(model, parameters[model.focals + 2 :])


def _series(distortion: Distortion) -> tuple[str, ...]:
    """Note on COLMAP's FOV model, which uses another function for tiny angles, with a difference of up to 0.1 px."""
    if isinstance(distortion, FieldOfView) and 0 < abs(distortion.omega) < SERIES_BELOW:
        return (
            "COLMAP evaluates FOV by a series below |omega| = 0.01, which is off by up to 0.1 px; this is not",
        )
    return ()


HEADING = (
    "# Camera list with one line of data per camera:",
    "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
)
MAX_BYTES = 8 * 1024 * 1024
LARGEST_WHOLE = 2.0**53

_COUNT = re.compile(r"#\s*Number of cameras:\s*(\d{1,9})\b")
_PANORAMAS = dict(PANORAMAS.values())
_NAMES = "|".join([*(model.name for model in COLMAP_MODELS), *_PANORAMAS])
_CAMERA = re.compile(rf"\d{{1,10}}\s+(?:{_NAMES})\s+\d{{1,7}}\s+\d{{1,7}}\s+[-+.\d]")


def sniff_text(content: Content) -> Sniff | None:
    """The heading that COLMAP writes; without it, a line that has a number and one of its models."""
    if content.first_line == HEADING[0]:
        return Sniff(Sure.MAGIC, f"the first line is '{HEADING[0]}'")
    first = next((line for line in content.lines if not line.startswith("#")), "")
    if _CAMERA.match(first):
        return Sniff(Sure.SHAPE, f"the first line that is not a comment is a camera, '{first[:40]}…'")
    return None


def read_text(data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """Every camera, in the order of the lines."""
    strict.refuse_longer(data, MAX_BYTES, "COLMAP's text")
    found: list[StoredCamera] = []
    announced = 0
    rows = strict.lines(strict.decode(data))
    for index, row in enumerate(rows, start=1):
        text = row.strip()
        if text.startswith("#"):
            count = _COUNT.match(text)
            announced = int(count[1]) if count else announced
        elif text:
            alike = None if found else _alike_text(rows, index)
            if alike is not None and len(alike) >= announced:
                return cameras(alike, context, grade=Grade.ADJUSTED)
            if len(found) == MAX_CAMERAS:
                raise ParseError(f"there are over {MAX_CAMERAS} cameras")
            found.append(_camera(text.split(), place=f"line {index}"))
    if len(found) < announced:
        raise ParseError(
            f"{len(found)} cameras where the heading counts {announced}; the file is cut short, or correct it"
        )
    return cameras(found, context, grade=Grade.ADJUSTED)


def write_text(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """As COLMAP writes it, with digits that read back bit for bit."""
    lines = [*HEADING, f"# Number of cameras: {len(calibrations)}"]
    for number, camera in records(calibrations):
        lines.append(
            f"{number} {camera.model} {camera.width} {camera.height} {' '.join(map(repr, camera.params))}"
        )
    return "".join(f"{line}\n" for line in lines).encode()


def write_columns_text(columns: Columns) -> bytes | None:
    """The same of many cameras of one of COLMAP's models."""
    model = columns.model
    if not isinstance(model, ColmapModel):
        return None
    numbers = np.concatenate([columns.K[:, 2 - model.focals :], columns.coefficients], axis=1).tolist()
    lines = [
        f"{number} {model.name} {width} {height} {' '.join(map(repr, own))}"
        for number, (width, height), own in zip(
            columns.ids.tolist(), columns.sizes.tolist(), numbers, strict=True
        )
    ]
    return "\n".join([*HEADING, f"# Number of cameras: {len(lines)}", *lines, ""]).encode()


def _alike_text(rows: Sequence[str], first: int) -> StoredColumns | None:
    """The cameras from a line on as columns, where all are of one model and there is nothing else; else None."""
    words = [row.split() for row in rows[first - 1 :]]
    name = words[0][1] if len(words[0]) > 1 else ""
    model = model_named(name)
    if (
        model is None
        or not FEW <= len(words) <= MAX_CAMERAS
        or set(map(len, words)) != {4 + model.count}
        or {row.pop(1) for row in words} != {name}
    ):
        return None
    values = strict.plain_numbers(" ".join(map(" ".join, words)), [*chain.from_iterable(words)])
    if values is None:
        return None
    table = np.array(values).reshape(len(words), -1)
    heads = table[:, :3]
    if not ((heads >= 0) & (heads < LARGEST_WHOLE) & (heads == np.floor(heads))).all():
        return None
    return StoredColumns(model, heads[:, 0], heads[:, 1:], table[:, 3:], "line {}", first)


def _camera(words: list[str], *, place: str) -> StoredCamera:
    """One line's camera."""
    if len(words) < 5:
        raise ParseError(
            f"{len(words)} words, expected a number, a model, a width, a height and the parameters",
            place=place,
        )
    number, width, height = (strict.whole(words[i], place=place) for i in (0, 2, 3))
    name = words[1]
    model = model_named(name)
    if model is None and name not in _PANORAMAS:
        raise UnsupportedModelError(
            f"COLMAP has no model {strict.shown(name)} that is known here, expected one of "
            f"{', '.join(item.name for item in COLMAP_MODELS)}",
            place=place,
        )
    count = model.count if model is not None else _PANORAMAS[name]
    if number < 0:
        raise ParseError(f"camera {number}, expected a number from 0", place=place)
    if len(words) - 4 != count:
        raise ParseError(f"{name} with {len(words) - 4} parameters, expected {count}", place=place)
    return StoredCamera(
        number=number,
        model=model or name,
        width=width,
        height=height,
        parameters=tuple(strict.number(word, place=place) for word in words[4:]),
        place=place,
    )


TEXT = Format(
    name="colmap_text",
    title="COLMAP cameras.txt",
    words="""\
COLMAP's ``cameras.txt``: one line for each camera of a reconstruction.

In the format's own words::

    # Camera list with one line of data per camera:
    #   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
    # Number of cameras: 2
    1 OPENCV 5472 3648 3650.12 3648.77 2745.81 1820.37 -0.0125 0.0231 -0.00037 0.00081
    2 SIMPLE_RADIAL 4000 3000 2981.4 2000 1500 -0.03

The parameters are those of the model, see :mod:`calibrary.interop.colmap`. Lines that begin with # are comments. If the
last of them counts more cameras than the file has, the file was cut off. COLMAP writes it after bundle adjustment; a
folder that contains ``cameras.bin`` as well is read from that.

Source: COLMAP documentation, "Output Format".
""",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://colmap.github.io/format.html#cameras-txt",
    convention=CONVENTION,
    sniff=sniff_text,
    read=read_text,
    write=write_text,
    write_columns=write_columns_text,
    capacity=CAPACITY,
)


COUNT = struct.Struct("<Q")
HEAD = struct.Struct("<IiQQ")
LONGEST_SIDE_PX = 1_000_000
MODELS: Final[Mapping[int, ColmapModel | str]] = MappingProxyType(
    {model.number: model for model in COLMAP_MODELS}
    | {number: name for number, (name, _) in PANORAMAS.items()}
)
PARAMETERS: Final = MappingProxyType(
    {model.number: struct.Struct(f"<{model.count}d") for model in COLMAP_MODELS}
    | {number: struct.Struct(f"<{count}d") for number, (_, count) in PANORAMAS.items()}
)
"""Those of each model, by its number."""


def sniff_binary(content: Content) -> Sniff | None:
    """Known models and plausible sizes, one after the other up to the very last byte."""
    data = content.data
    if len(data) < COUNT.size + HEAD.size:
        return None
    [count] = COUNT.unpack_from(data)
    if not 0 < count <= (len(data) - COUNT.size) // HEAD.size:
        return None
    claim = Sniff(Sure.SHAPE, f"{count} cameras of known models fill it to the last byte")
    rows = _alike_binary(data)
    if rows is not None:
        sides = np.stack([rows["width"], rows["height"]])
        return claim if ((sides > 0) & (sides <= LONGEST_SIDE_PX)).all() else None
    at, last = COUNT.size, len(data) - HEAD.size
    for _ in range(count):
        if at > last:
            return None
        _number, model, width, height = HEAD.unpack_from(data, at)
        if model not in PARAMETERS or not (0 < width <= LONGEST_SIDE_PX and 0 < height <= LONGEST_SIDE_PX):
            return None
        at += HEAD.size + PARAMETERS[model].size
    if at != len(data):
        return None
    return claim


def read_binary(data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """Every camera, in order."""
    rows = _alike_binary(data)
    if rows is None:
        return cameras(list(_cameras(data)), context, grade=Grade.ADJUSTED)
    model = MODELS[int(rows["model"][0])]
    sizes = np.stack([rows["width"], rows["height"]], axis=1)
    if isinstance(model, str) or (sizes > LONGEST_SIDE_PX).any():
        return cameras(list(_cameras(data)), context, grade=Grade.ADJUSTED)
    place = f"camera {{}} of {len(rows)}"
    stored = StoredColumns(model, rows["number"], sizes, rows["parameters"], place)
    return cameras(stored, context, grade=Grade.ADJUSTED)


def write_binary(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """As COLMAP writes it."""
    parts = [COUNT.pack(len(calibrations))]
    for number, camera in records(calibrations):
        model = model_named(camera.model)
        if model is None:
            raise UnsupportedModelError(f"COLMAP has no model {camera.model}")
        parts.append(HEAD.pack(number, model.number, camera.width, camera.height))
        parts.append(struct.pack(f"<{model.count}d", *camera.params))
    return b"".join(parts)


def write_columns_binary(columns: Columns) -> bytes | None:
    """The same of many cameras of one of COLMAP's models."""
    model = columns.model
    if not isinstance(model, ColmapModel):
        return None
    rows = np.empty(len(columns.ids), _row(model.count))
    rows["number"], rows["model"] = columns.ids, model.number
    rows["width"], rows["height"] = columns.sizes.T
    rows["parameters"] = np.concatenate([columns.K[:, 2 - model.focals :], columns.coefficients], axis=1)
    return COUNT.pack(len(rows)) + rows.tobytes()


def _row(parameters: int) -> np.dtype[np.void]:
    head = [("number", "<u4"), ("model", "<i4"), ("width", "<u8"), ("height", "<u8")]
    return np.dtype([*head, ("parameters", "<f8", (parameters,))])


def _alike_binary(data: bytes) -> NDArray[np.void] | None:
    """The cameras as columns, where all are of one model, as one program's mostly are, and fill the file exactly."""
    if len(data) < COUNT.size + HEAD.size:
        return None
    [count] = COUNT.unpack_from(data)
    _, model, _, _ = HEAD.unpack_from(data, COUNT.size)
    parameters = PARAMETERS.get(model)
    if parameters is None or count > MAX_CAMERAS:
        return None
    kind = _row(parameters.size // 8)
    if COUNT.size + count * kind.itemsize != len(data):
        return None
    rows: NDArray[np.void] = np.frombuffer(data, kind, count, COUNT.size)
    return rows if (rows["model"] == model).all() else None


def _cameras(data: bytes) -> Iterator[StoredCamera]:
    if len(data) < COUNT.size:
        raise ParseError(f"{len(data)} bytes, expected a number of cameras in the first 8")
    (count,) = COUNT.unpack_from(data)
    if not count:
        raise ParseError("it states 0 cameras, expected 1 or more")
    if count > MAX_CAMERAS:
        raise ParseError(f"it states {count} cameras; at most {MAX_CAMERAS} are read")
    at = COUNT.size
    for index in range(1, count + 1):
        place = f"camera {index} of {count}"
        if at + HEAD.size > len(data):
            raise ParseError("the file ends inside it", place=place)
        number, model, width, height = HEAD.unpack_from(data, at)
        parameters = PARAMETERS.get(model)
        if parameters is None:
            raise UnsupportedModelError(
                f"COLMAP's model {model} is not known here, so the rest cannot be read; write the "
                "reconstruction as text (colmap model_converter --output_type TXT)",
                place=place,
            )
        at += HEAD.size
        if at + parameters.size > len(data):
            raise ParseError("the file ends inside it", place=place)
        numbers = parameters.unpack_from(data, at)
        at += parameters.size
        yield StoredCamera(number, MODELS[model], width, height, numbers, place)
    if at != len(data):
        raise ParseError(f"{len(data) - at} bytes follow the last camera")


BINARY = Format(
    name="colmap_binary",
    title="COLMAP cameras.bin",
    words="""\
COLMAP's ``cameras.bin``: the cameras of a reconstruction, without a mark of its own.

In the format's own words, all of it little endian::

    uint64  number of cameras
    of each camera:
        uint32  camera id        int32   model id
        uint64  width            uint64  height
        double  parameters[as many as the model has]

Only the model determines the length of a camera's record, so after an unknown model the rest cannot be read. The
parameters are those of ``cameras.txt``, see :mod:`calibrary.interop.colmap`. calibrary recognises a file because its
cameras fill it to the last byte.

Source: COLMAP, ``WriteCamerasBinary`` and ``scripts/python/read_write_model.py``.
""",
    suffixes=(".bin",),
    syntaxes=(Syntax.BINARY,),
    reference="https://colmap.github.io/format.html#binary-file-format",
    convention=CONVENTION,
    sniff=sniff_binary,
    read=read_binary,
    write=write_binary,
    write_columns=write_columns_binary,
    capacity=CAPACITY,
)

FORMATS = (
    TEXT,
    BINARY,
)
