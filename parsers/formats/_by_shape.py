"""Hand-made files of K and a distortion, whatever they call them: brought to the keys of an OpenCV file.

Scripts write K as a matrix or as fx, fy, cx, cy, the coefficients as a vector, as radial and tangential ones, or one by
one, and put either below a key such as ``calibration`` or ``intrinsics``. :func:`shaped` makes one table of it, with
a camera matrix and a vector of coefficients in OpenCV's order; what it does not know stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from calibrary.distortion import Distortion, KannalaBrandt
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import names
from calibrary.parsers import text as strict
from calibrary.parsers.document import Node
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.parsers.names import MATRIX, VECTOR, Family, simplified
from calibrary.records import Json

AROUND = frozenset({
    "calibration", "calibrationdata", "calib", "camera", "cameraparameters", "cameraparams", "parameters", "params",
    "intrinsic", "intrinsics", "cameraintrinsics", "intrinsicparameters", "distortion", "distortionparameters",
    "distortionparams", "dist", "result", "results", "data", "resolution", "imagesize", "size", "imageresolution",
})  # fmt: skip
"""Keys of tables that only put others together."""
DEPTH = 2
PAIRS = (names.ONE_FOCAL, names.ONE_CENTRE)
OPENCV_COUNTS = (5, 8, 12, 14)
"""Lengths of a vector that is OpenCV's; four may be a fisheye's."""
RADIALS, TANGENTIALS = tuple(f"k{n}" for n in range(1, 7)), ("p1", "p2")


def is_fisheye(simple: Mapping[str, str], tree: Node) -> bool | None:
    """Whether a file names cv2.fisheye's model; None if it names neither that nor OpenCV's other one.

    Args:
        simple: its keys, by their simplified form.
        tree: the file.

    Raises:
        UnsupportedModelError: the distortion's model is another one.
    """
    for name in names.MODELS:
        word = tree[simple[name]].value if name in simple else None
        found = names.family(word) if isinstance(word, str) else None
        if found in {Family.OPENCV, Family.FISHEYE}:
            return found is Family.FISHEYE
        if isinstance(word, str) and name in names.OF_DISTORTION:
            raise UnsupportedModelError(
                f"the distortion's model is {strict.shown(word)}, which is not known here; expected that of OpenCV "
                "(plumb_bob, radtan) or of cv2.fisheye (fisheye, equidistant)",
                source=tree.source,
                place=simple[name],
            )
    return None


def lifted(tree: Node) -> Node:
    """The table with what is in tables that only put others together."""
    if not isinstance(tree.value, dict):
        return tree
    table = tree.value
    for _ in range(DEPTH):
        found: dict[str, Json] = {}
        for key, value in table.items():
            if simplified(key) in AROUND and isinstance(value, dict) and "data" not in value:
                inner = {_lifted_name(key, name): item for name, item in value.items()}
                found |= {
                    name: item for name, item in inner.items() if name not in table and name not in found
                }
            else:
                found[key] = value
        if len(found) == len(table) and found.keys() == table.keys():
            break
        table = found
    return Node(table, source=tree.source, place=tree.place)


def _lifted_name(table: str, key: str) -> str:
    is_the_lens_model = simplified(key) in {"model", "type"} and simplified(table).startswith("dist")
    return "distortion_model" if is_the_lens_model else key


def shaped(tree: Node) -> Node:
    """The table with a camera matrix and a vector of coefficients, if it states them in another shape."""
    tree = lifted(tree)
    if not isinstance(tree.value, dict):
        return tree
    table, by_name = tree.value, _by_name(tree)
    lists = {key: value for key, value in table.items() if isinstance(value, dict | list)}
    if not any(MATRIX.fullmatch(simplified(key)) for key in lists):
        used, numbers = _focals_and_centre(tree, by_name)
        if used:
            fx, fy, cx, cy = numbers
            rest = {key: value for key, value in table.items() if key not in used}
            table = {**rest, "camera_matrix": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]}
    if not any(VECTOR.fullmatch(simplified(key)) for key in lists):
        keys, values = _coefficients_of(tree)
        if keys:
            rest = {key: value for key, value in table.items() if key not in keys}
            table = {**rest, "distortion_coefficients" if len(values) != 4 else "dist": list[Json](values)}
    return Node(table, source=tree.source, place=tree.place)


def lens_of(
    tree: Node, *, fisheye: bool | None = None
) -> tuple[tuple[str, ...], tuple[float, ...], Distortion | None]:
    """The lens of a table, in whatever shape it states it: its keys, its numbers, the lens.

    Args:
        tree: the table.
        fisheye: whether four coefficients, where the table does not name their model, are cv2.fisheye's.

    Returns:
        None for the lens where there are no coefficients, or their number does not determine the model.
    """
    by_name = _by_name(tree)
    named = is_fisheye(by_name, tree)
    fisheye = fisheye if named is None else named
    found = next(
        (key for key, node in tree.entries() if VECTOR.fullmatch(simplified(key)) and _is_vector(node)),
        None,
    )
    keys: tuple[str, ...] = () if found is None else (found,)
    values = storage.numbers(tree[found]) if found is not None else ()
    if not values:
        keys, values = _coefficients_of(tree)
    is_four = len(values) == 4
    if fisheye and is_four:
        return keys, values, KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=True)))
    of_brown = len(values) in OPENCV_COUNTS or (is_four and found is not None and fisheye is False)
    return keys, values, lens(values) if of_brown and not fisheye else None


def _is_vector(node: Node) -> bool:
    value = node.value
    return isinstance(value, list) or (isinstance(value, dict) and "data" in value)


def _coefficients_of(tree: Node) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Keys and numbers, in OpenCV's order, of coefficients that are no single vector; none if there are none.

    Four radial ones without tangential ones stay four: they may be a fisheye's.
    """
    by_name = _by_name(tree)
    radial_key, tangential_key = (
        next((name for name in every if name in by_name), None) for every in (names.RADIAL, names.TANGENTIAL)
    )
    if radial_key is not None and isinstance(tree[by_name[radial_key]].value, dict | list):
        radial = storage.numbers(tree[by_name[radial_key]])
        keys = [by_name[radial_key]]
        tangential: Sequence[float] = ()
        if tangential_key is not None:
            tangential = storage.numbers(tree[by_name[tangential_key]])
            keys.append(by_name[tangential_key])
        if len(radial) not in {1, 2, 3, 6} or len(tangential) not in {0, 2}:
            return (), ()
        return tuple(keys), _in_order(radial, tangential)
    given = [name for name in (*RADIALS, *TANGENTIALS) if name in by_name and _is_number(tree, by_name[name])]
    if not {"k1", "p1"} & set(given):
        return (), ()
    numbers = {name: tree[by_name[name]].number() for name in given}
    keys = [by_name[name] for name in given]
    if "k4" in given and not {"k5", "k6", *TANGENTIALS} & set(given):
        return tuple(keys), tuple(numbers.get(name, 0.0) for name in RADIALS[:4])
    terms = [numbers.get(name, 0.0) for name in (RADIALS if {"k4", "k5", "k6"} & set(given) else RADIALS[:3])]
    return tuple(keys), _in_order(terms, [numbers.get(name, 0.0) for name in TANGENTIALS])


def _in_order(radial: Sequence[float], tangential: Sequence[float]) -> tuple[float, ...]:
    k = [*radial, *[0.0] * 3]
    p = tangential or (0.0, 0.0)
    return (k[0], k[1], *p, *(k[2:6] if len(radial) == 6 else k[2:3]))


def _focals_and_centre(tree: Node, by_name: Mapping[str, str]) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Keys and numbers of fx, fy, cx, cy: one by one, or two pairs."""
    numbered = {name for name, key in by_name.items() if _is_number(tree, key)}
    found = [
        next((pair for pair in pairs if set(pair) <= numbered), None)
        for pairs in (names.FOCALS, names.CENTRES)
    ]
    if found[0] and found[1]:
        keys = tuple(by_name[name] for name in (*found[0], *found[1]))
        return keys, tuple(tree[key].number() for key in keys)
    pairs = [next((name for name in choices if name in by_name), None) for choices in PAIRS]
    if pairs[0] and pairs[1]:
        keys = tuple(by_name[name] for name in pairs if name)
        values = [
            storage.numbers(tree[key]) if isinstance(tree[key].value, dict | list) else () for key in keys
        ]
        if [len(value) for value in values] == [2, 2]:
            return keys, (*values[0], *values[1])
    return (), ()


def _by_name(tree: Node) -> dict[str, str]:
    found: dict[str, str] = {}
    for key, _ in tree.entries():
        found.setdefault(simplified(key), key)
    return found


def _is_number(tree: Node, key: str) -> bool:
    value = tree[key].value
    return isinstance(value, int | float) and not isinstance(value, bool)
