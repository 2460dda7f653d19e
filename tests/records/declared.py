"""Hypothesis strategies drawn from the declarations of records, and the records that differ from one in one field."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC
from typing import Any, cast

from hypothesis import reject
from hypothesis import strategies as st
from msgspec import Meta, inspect

from calibrary.calibration import Calibration, Grade
from calibrary.catalogue import Maker
from calibrary.distortion import Distortion
from calibrary.errors import InputError
from calibrary.jobs.extract.report import CameraDocument
from calibrary.known_camera import CLAIMS, NEEDS, KnownCamera
from calibrary.quality import Covariance, Quality
from calibrary.records import Record, flat, replace
from calibrary.registry.entry import LIMITS, TRACED_BY, Entry
from calibrary.registry.firmware import FirmwareRange
from tests.strategies import any_distortions

LARGEST = 1e6
WORDS = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12).filter(str.strip)


def strategy_for(kind: type[Record], limits: Mapping[str, Meta] | None = None) -> st.SearchStrategy[Any]:
    """Records of a kind with anything in every field that its declaration allows.

    Args:
        kind: its class.
        limits: bounds beyond the declaration's, by dotted path.
    """
    if kind in SPECIAL:
        return cast("st.SearchStrategy[Any]", SPECIAL[kind](limits or {}))
    return _plainly(kind, limits or {})


def _plainly(kind: type[Record], limits: Mapping[str, Meta]) -> st.SearchStrategy[Any]:
    """Each field drawn by itself."""
    info = cast("inspect.StructType", inspect.type_info(kind))
    written = [field for field in info.fields if field.name not in kind._unwritten]
    fields = {field.name: _of(field.type, field.encode_name, limits) for field in written}

    @st.composite
    def records(draw: st.DrawFn) -> Any:
        values = {name: draw(strategy) for name, strategy in fields.items()}
        try:
            return kind(**values)
        except InputError:
            reject()

    return records()


def _of(type_: inspect.Type, path: str, limits: Mapping[str, Meta]) -> st.SearchStrategy[Any]:  # noqa: PLR0911  a case a kind
    """Values of one field; ``path`` is where its bounds are looked up."""
    match type_:
        case inspect.Metadata():
            words = (type_.extra_json_schema or {}).get("enum")
            return st.sampled_from(words) if words else _of(type_.type, path, limits)
        case inspect.UnionType():
            kinds = [one for one in type_.types if isinstance(one, inspect.StructType)]
            if kinds and issubclass(kinds[0].cls, Distortion):
                return st.none() | any_distortions()
            return st.one_of(*(_of(one, path, limits) for one in type_.types))
        case inspect.StructType():
            inner = {
                name.partition(".")[2]: bounds
                for name, bounds in limits.items()
                if name.startswith(f"{path}.")
            }
            # An entry's limits are of the file's form, in which the calibration's members stand at its top.
            return strategy_for(cast("type[Record]", type_.cls), limits if path == "calibration" else inner)
        case inspect.EnumType():
            return st.sampled_from([*type_.cls])
        case inspect.TupleType():
            return st.tuples(*(_of(one, path, limits) for one in type_.item_types))
        case inspect.VarTupleType():
            least = type_.min_length or 0
            return st.lists(_of(type_.item_type, path, limits), min_size=least, max_size=least + 2).map(tuple)
        case inspect.DictType():
            return st.dictionaries(WORDS, _of(type_.value_type, path, limits), max_size=2)
        case inspect.AnyType():
            return st.none() | st.booleans() | st.integers(-9, 9) | WORDS
    return _scalar(type_, limits.get(path) or Meta())


def _scalar(type_: inspect.Type, bounds: Meta) -> st.SearchStrategy[Any]:
    def bound(name: str) -> Any:
        own = getattr(type_, name, None)
        return own if own is not None else getattr(bounds, name)

    low = next((value for value in (bound("gt"), bound("ge")) if value is not None), -LARGEST)
    below = getattr(type_, "lt", None)
    high = next((value for value in (below, bound("le")) if value is not None), LARGEST)
    match type_:
        case inspect.NoneType():
            return st.none()
        case inspect.BoolType():
            return st.booleans()
        case inspect.IntType():
            return st.integers(int(low) + (bound("gt") is not None), int(high) - (below is not None))
        case inspect.FloatType():
            return st.floats(low, high, exclude_min=bound("gt") is not None, exclude_max=below is not None)
        case inspect.DateType():
            return st.dates()
        case inspect.DateTimeType():
            return st.datetimes(timezones=st.just(UTC))
        case inspect.LiteralType():
            return st.sampled_from([*type_.values])
        case inspect.StrType():
            pattern = bound("pattern")
            longest = bound("max_length") or 1000
            matching = st.from_regex(pattern, fullmatch=True, alphabet=ASCII) if pattern else WORDS
            return matching.filter(lambda text: len(text) <= longest)
    raise NotImplementedError(f"no values are known of {type_}")


ASCII = st.characters(min_codepoint=32, max_codepoint=126)


def _parts(draw: st.DrawFn, kind: type[Record], limits: Mapping[str, Meta]) -> dict[str, Any]:
    """A value of each field."""
    info = cast("inspect.StructType", inspect.type_info(kind))
    return {field.name: draw(_of(field.type, field.encode_name, limits)) for field in info.fields}


@st.composite
def _covariances(draw: st.DrawFn, _limits: Mapping[str, Meta]) -> Covariance:
    names = draw(st.lists(st.sampled_from(["fx", "fy", "cx", "cy", "k1"]), min_size=1, unique=True))
    count = len(names) * (len(names) + 1) // 2
    upper = draw(st.lists(st.floats(0, 1e3), min_size=count, max_size=count))
    return Covariance(names=tuple(names), upper=tuple(upper))


@st.composite
def _entries(draw: st.DrawFn, _limits: Mapping[str, Meta]) -> Entry:
    """Entries: what ties their parts together is put right, all else is as it was drawn."""
    drawn_parts = _parts(draw, Entry, LIMITS)
    parts = {name: part for name, part in drawn_parts.items() if name not in Entry._unwritten}
    drawn: Calibration = parts["calibration"]
    camera = replace(
        drawn.camera,
        make=drawn.camera.make or "DJI",
        model=drawn.camera.model or "FC6310R",
        image_size=drawn.intrinsics.image_size,
        firmware=None,
    )
    grade = drawn.grade if drawn.grade.is_metric else Grade.DERIVED
    made = drawn.provenance
    if made.kind in {*TRACED_BY, "registry", "seed", "unstated"}:
        made = replace(made, kind="laboratory")
    keys = [f"x-{key}" for key in ("a", "b")] + ["camera/x-c", "provenance/x-d"]
    said = draw(st.dictionaries(st.sampled_from(keys), st.integers(0, 9) | WORDS, max_size=2))
    calibration = replace(drawn, camera=camera, grade=grade, provenance=made, extras=_once(drawn.extras))
    label = parts["label"]
    if label is not None and (label != " ".join(label.split()) or not label.isprintable()):
        label = "P4R-03"
    return Entry(**parts | {"calibration": calibration, "extensions": said, "label": label})


@st.composite
def _calibrations(draw: st.DrawFn, limits: Mapping[str, Meta]) -> Calibration:
    parts = _parts(draw, Calibration, limits)
    return Calibration(**parts | {"extras": _once(parts["extras"])})


def _once(pairs: tuple[tuple[str, str], ...]) -> tuple[tuple[str, str], ...]:
    """Each key once, as in a file."""
    return tuple(dict(pairs).items())


def _qualities(limits: Mapping[str, Meta]) -> st.SearchStrategy[Quality]:
    """Those that state something: an empty one is as none in every view."""
    return _plainly(Quality, limits).filter(flat)


def _reported(limits: Mapping[str, Meta]) -> st.SearchStrategy[CameraDocument]:
    """A camera is written once, in its calibration where it has one."""
    return _plainly(CameraDocument, limits).map(
        lambda one: replace(one, camera=one.calibration.camera) if one.calibration is not None else one
    )


@st.composite
def _known_cameras(draw: st.DrawFn, limits: Mapping[str, Meta]) -> KnownCamera:
    """Every number beside its source, every name once, and no field without the one it needs."""
    parts = _parts(draw, KnownCamera, limits)
    parts |= {name: tuple(dict.fromkeys(value)) for name, value in parts.items() if isinstance(value, tuple)
              and name not in CLAIMS}  # fmt: skip
    parts |= {name: None for name, needed in NEEDS.items() if parts[needed] is None}
    stated = {name for name in CLAIMS if parts[name] is not None}
    sources = tuple((name, draw(WORDS)) for name in KnownCamera.__struct_fields__ if name in stated)
    return KnownCamera(**parts | {"sources": sources})


def _makers(limits: Mapping[str, Meta]) -> st.SearchStrategy[Maker]:
    """All cameras of the make."""
    cameras = st.lists(strategy_for(KnownCamera, limits), min_size=1, max_size=2)
    return cameras.map(
        lambda some: Maker(make=some[0].make, cameras=tuple(replace(one, make=some[0].make) for one in some))
    )


def _ranges(_limits: Mapping[str, Meta]) -> st.SearchStrategy[FirmwareRange]:
    return st.sampled_from([FirmwareRange(min="01.00.0128"), FirmwareRange(min="1.9", max="01.10")])


SPECIAL: dict[type[Record], Any] = {
    Covariance: _covariances,
    Entry: _entries,
    Calibration: _calibrations,
    FirmwareRange: _ranges,
    Quality: _qualities,
    KnownCamera: _known_cameras,
    Maker: _makers,
    CameraDocument: _reported,
}
"""Records whose fields hang together, so that drawing each by itself would give hardly one."""


def neighbours(record: Record, other: Record) -> Iterator[tuple[str, Record]]:
    """The record with one field, anywhere inside it, taken from another record of its kind: its path and the record."""
    for name in record.__struct_fields__:
        mine, theirs = getattr(record, name), getattr(other, name)
        if mine == theirs:
            continue
        if isinstance(mine, Record) and type(mine) is type(theirs):
            changes = [(f"{name}.{path}", part) for path, part in neighbours(mine, theirs)]
        else:
            changes = [(name, theirs)]
        for path, value in changes:
            try:
                yield path, replace(record, **{name: value})
            except InputError:
                continue
