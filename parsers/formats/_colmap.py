"""Shared by COLMAP's text file, binary file and database: conventions, and the list of cameras by number."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Final, NamedTuple, TypeVar, cast, overload

from calibrary.arrays import ArrayLike, BoolArray, np
from calibrary.calibration import Calibration, Grade, ImageSize, Intrinsics, Origin
from calibrary.distortion import Distortion, FieldOfView, NoDistortion
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.interop.colmap import (
    COLMAP_LENSES,
    ColmapCamera,
    ColmapModel,
    default_model,
    lens_from,
    model_for,
)
from calibrary.parsers import text as strict
from calibrary.parsers.convention import Convention
from calibrary.parsers.format import Capacity, ReadContext, UnknownLens
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
