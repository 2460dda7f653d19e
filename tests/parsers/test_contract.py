"""What every format must do: taken from the records, so a new format is tested by being there."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from functools import cache
from importlib import import_module

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade, Provenance, Quality
from calibrary.distortion import Distortion, NoDistortion, exact
from calibrary.errors import (
    InputError,
    MissingTagError,
    ParseError,
    UnknownFormatError,
    UnsupportedModelError,
)
from calibrary.parsers.content import Content
from calibrary.parsers.format import STATED, Capacity, Fidelity, Format
from calibrary.parsers.reading import identified
from calibrary.records import replace
from tests.parsers.cameras import SIZE, calibrations, camera, rays
from tests.parsers.samples import Sample, exported
from tests.thorough import every, examples

FORMATS = parsers.formats()
READABLE = [pytest.param(record, id=record.name) for record in FORMATS if record.read is not None]
WRITTEN = [
    pytest.param(record, f"camera{suffix}", id=f"{record.name}{suffix}")
    for record in FORMATS
    if record.write is not None
    for suffix in record.suffixes
]
NOT_WRITTEN = [pytest.param(record, id=record.name) for record in FORMATS if record.write is None]
FILES = [
    *WRITTEN,
    *(
        pytest.param(record, f"camera{record.suffixes[0]}", id=record.name)
        for record in FORMATS
        if record.write is None and record.read is not None
    ),
]
"""One of each: what the format's writer makes of a camera, else what the format's own test exports."""

NOISE = st.one_of(st.binary(max_size=300), st.text(max_size=200).map(str.encode))
PATIENT = settings(
    deadline=None,
    max_examples=examples(12),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


AFFINE_LENS = {"australis_report", "micmac_xml"}
"""One focal length or no skew, and a lens with b1 and b2 that makes up for it."""
DAMAGED_FILES = examples(20, 1200)
STRUCTURAL = np.frombuffer(b"\0\n\t 019-+.,eE:;=#%&<>/()[]{}\"'\\\xff", dtype=np.uint8)


def capacity_of(record: Format) -> Capacity:
    assert record.capacity is not None
    return record.capacity


def a_camera_for(record: Format) -> Calibration:
    """One that the format holds exactly, with its first real lens model."""
    capacity = capacity_of(record)
    lens: Distortion | None = None
    for model in capacity.models:
        lens = model(**{name: 0.001 * (index + 1) / 3 for index, name in enumerate(model.names())})
        if model is not NoDistortion:
            break
    item = camera(lens)
    K = item.intrinsics
    if not capacity.two_focals:
        K = replace(K, fy=K.fx)
    if not capacity.off_centre:
        K = replace(K, cx=SIZE[0] / 2, cy=SIZE[1] / 2)
    return replace(item, intrinsics=K)


def written(record: Format, name: str) -> bytes:
    return parsers.encode([a_camera_for(record)], record, name=name)[0]


@cache
def sample(record: Format, name: str) -> Sample:
    if record.write is not None:
        return Sample(written(record, name))
    return exported().get(record.name) or pytest.fail(
        f"tests/parsers/formats/test_{record.name}.py exports no SAMPLES = {{{record.name!r}: Sample(…)}}"
    )


def read_back(record: Format, name: str, data: bytes, size: tuple[int, int] = SIZE) -> Sequence[Calibration]:
    return parsers.decode(
        data,
        name=name,
        format=record,
        image_size=size if record.needs_image_size else None,
        options=sample(record, name).options,
        companion=sample(record, name).beside.get,
    )


def facts(calibration: Calibration) -> set[tuple[str, object]]:
    """What a calibration knows of its quality, one by one."""
    quality = calibration.quality or Quality()
    known = {
        "rms": quality.rms_px,
        "points": quality.points,
        "views": quality.views,
        "covariance": quality.covariance,
    }
    return {(name, value) for name, value in (known | dict(quality.std)).items() if value is not None}


@pytest.mark.parametrize("record", [pytest.param(record, id=record.name) for record in FORMATS])
def test_a_record_says_what_people_need_to_know(record: Format) -> None:
    assert record.title
    assert record.reference.startswith("https://")
    assert record.suffixes
    assert all(suffix.startswith(".") and suffix == suffix.lower() for suffix in record.suffixes)
    if record.convention is not None:
        assert all(record.convention.sentences())


@pytest.mark.parametrize("record", [pytest.param(record, id=record.name) for record in FORMATS])
def test_a_format_is_documented_in_its_own_words(record: Format) -> None:
    doc = record.words or import_module(record.sniff.__module__).__doc__
    assert doc
    assert len(doc.splitlines()) > 5


@pytest.mark.parametrize(("record", "name"), WRITTEN)
@PATIENT
@given(data=st.data())
def test_what_is_written_reads_back_the_same(record: Format, name: str, data: st.DataObject) -> None:
    original = data.draw(calibrations(capacity_of(record)))
    file, verdict = parsers.encode([original], record, name=name)
    [copy] = read_back(record, name, file, original.intrinsics.image_size)
    assert verdict.outcome is Fidelity.EXACT
    scale = max(*original.intrinsics.image_size, original.intrinsics.fx)
    np.testing.assert_allclose(copy.intrinsics.matrix, original.intrinsics.matrix, rtol=0, atol=1e-12 * scale)
    assert copy.intrinsics.image_size == original.intrinsics.image_size
    if copy.distortion is not None:
        again = exact(copy.distortion, type(original.distortion or NoDistortion()))
        assert again is not None
        before = (original.distortion or NoDistortion()).coefficients
        np.testing.assert_allclose(
            list(again.coefficients.values()), list(before.values()), rtol=1e-12, atol=0
        )


@pytest.mark.parametrize(("record", "name"), WRITTEN)
@PATIENT
@given(data=st.data())
def test_what_is_written_projects_the_same(record: Format, name: str, data: st.DataObject) -> None:
    original = data.draw(calibrations(capacity_of(record)))
    file, _ = parsers.encode([original], record, name=name)
    [copy] = read_back(record, name, file, original.intrinsics.image_size)
    seen = data.draw(rays())
    before = original if copy.distortion is not None else replace(original, distortion=None)
    scale = max(1.0, original.intrinsics.fx / 1e4)
    np.testing.assert_allclose(copy.project(seen), before.project(seen), rtol=0, atol=1e-9 * scale)


@pytest.mark.parametrize("record", NOT_WRITTEN)
def test_a_format_without_a_writer_brings_a_sample(record: Format) -> None:
    assert sample(record, "").data


def test_a_sample_belongs_to_a_format_that_needs_one() -> None:
    assert set(exported()) == {record.name for record in FORMATS if record.write is None}


@pytest.mark.parametrize(("record", "name"), [*FILES, *((item.values[0], "") for item in NOT_WRITTEN)])
def test_only_its_own_format_claims_a_file(record: Format, name: str) -> None:
    content = Content(sample(record, name).data, "no name to go by")
    assert identified(content).format.name == record.name
    own = record.sniff(content)
    assert own is not None
    for other in FORMATS:
        claim = other.sniff(content)
        assert other.name == record.name or claim is None or claim.sure < own.sure
        assert claim is None or content.syntax in other.syntaxes


@pytest.mark.parametrize(("record", "name"), FILES)
def test_every_camera_read_says_its_size_and_its_source(record: Format, name: str) -> None:
    file = sample(record, name).data
    copies = read_back(record, name, file)
    for copy in copies:
        assert copy.camera.image_size == copy.intrinsics.image_size
        assert copy.provenance.kind == "calibration-file"
        assert copy.provenance.source == name
        assert copy.provenance.sha256 == hashlib.sha256(file).hexdigest()
        assert copy.grade.is_metric or copy.grade is Grade.PRIOR
    if record.write is not None:
        assert [copy.intrinsics.image_size for copy in copies] == [SIZE]
    if len(copies) > 1:
        assert len({copy.camera.sub_camera for copy in copies} - {None}) == len(copies)


@pytest.mark.parametrize(("record", "name"), FILES)
def test_a_date_is_the_files_own_and_never_the_day_of_reading(record: Format, name: str) -> None:
    """A file of ours is written from a camera without a date; a sample states all that its format can."""
    today = datetime.now().astimezone().date().isoformat()
    for copy in read_back(record, name, sample(record, name).data):
        assert not (copy.provenance.date or "").startswith(today)
        for field in STATED:
            expected = record.write is None and field in record.states
            assert (getattr(copy.provenance, field) is not None) == expected, field
        if copy.provenance.date is not None:
            datetime.fromisoformat(copy.provenance.date)


@pytest.mark.parametrize("made", ["2019-05-14T10:22:31", "2019-05-14", "2019-05-14T10:22:31Z"])
@pytest.mark.parametrize(("record", "name"), WRITTEN)
def test_what_a_file_can_state_of_its_origin_comes_back(record: Format, name: str, made: str) -> None:
    stated = {name: f"the {name}, 3.1 (64-bit)" for name in STATED} | {"date": made}
    origin = replace(Provenance(kind="test"), **stated)
    item = replace(a_camera_for(record), provenance=origin)
    file, verdict = parsers.encode([item], record, name=name)
    [copy] = read_back(record, name, file)
    for field in STATED:
        kept = field in record.states
        assert getattr(copy.provenance, field) == (getattr(origin, field) if kept else None)
        assert (field in verdict.dropped) == (not kept)


@pytest.mark.parametrize(("record", "name"), FILES)
def test_a_file_cut_short_anywhere_is_noticed_or_reads_the_same(record: Format, name: str) -> None:
    """A list of cameras that does not say how many they are may lose the last ones, but none of its numbers.

    What stands behind the cameras, such as how well they fit, may go missing; it is never another.
    """
    noticed = ParseError if record.write is not None else (ParseError, UnsupportedModelError, MissingTagError)
    file = sample(record, name).data
    whole = read_back(record, name, file)
    for end in every(4, range(len(file))):
        try:
            part = read_back(record, name, file[:end])
        except noticed:
            continue
        assert len(part) <= len(whole)
        for copy, original in zip(part, whole, strict=False):
            assert (copy.intrinsics, copy.distortion) == (original.intrinsics, original.distortion), end
            assert facts(copy) <= facts(original), end
            if record.write is not None:
                assert facts(copy) == facts(original), end


@pytest.mark.parametrize("record", READABLE)
@PATIENT
@given(noise=NOISE)
def test_noise_is_no_file_of_this_format(record: Format, noise: bytes) -> None:
    with pytest.raises((ParseError, UnsupportedModelError)):
        parsers.decode(noise, name="noise", format=record, image_size=SIZE)


@PATIENT
@given(noise=NOISE)
def test_noise_is_claimed_by_nobody_or_is_broken(noise: bytes) -> None:
    with pytest.raises((UnknownFormatError, ParseError)):
        parsers.decode(noise, name="noise", image_size=SIZE)


@pytest.mark.parametrize(("record", "name"), FILES)
def test_a_damaged_file_raises_an_input_error_or_reads(record: Format, name: str) -> None:
    """Any bytes, and those that formats are made of, in place of a few others; the same files in every run."""
    random = np.random.default_rng(list(f"{record.name} {name}".encode()))
    whole = sample(record, name).data
    for _ in range(DAMAGED_FILES):
        file = bytearray(whole)
        for _ in range(random.integers(1, 5)):
            start = random.integers(0, len(file)) if file else 0
            pieces = random.bytes(3) if random.random() < 0.5 else bytes(random.choice(STRUCTURAL, 3))
            file[start : start + random.integers(0, 4)] = pieces[: random.integers(0, 4)]
        damaged = bytes(file)
        try:
            with suppress(InputError):
                read_back(record, name, damaged)
            with suppress(InputError):
                identified(Content(damaged, name))
        except Exception as error:
            error.add_note(f"the file was {damaged!r}")
            raise


@pytest.mark.parametrize(("record", "name"), WRITTEN)
def test_a_guess_is_never_written(record: Format, name: str) -> None:
    guess = replace(a_camera_for(record), grade=Grade.SEED)
    with pytest.raises(InputError, match="guess"):
        parsers.encode([guess], record, name=name)


@pytest.mark.parametrize(("record", "name"), WRITTEN)
def test_skew_is_kept_or_refused_but_never_lost_in_silence(record: Format, name: str) -> None:
    item = a_camera_for(record)
    skewed = replace(item, intrinsics=replace(item.intrinsics, skew=-23.1))
    if capacity_of(record).skew:
        file, _ = parsers.encode([skewed], record, name=name)
        assert read_back(record, name, file)[0].intrinsics.skew == pytest.approx(-23.1, rel=1e-12)
        return
    if record.name in AFFINE_LENS:
        assert parsers.encode([skewed], record, name=name, max_error_px=0.5)[1].max_px < 0.5
        return
    with pytest.raises(UnsupportedModelError, match="px"):
        parsers.encode([skewed], record, name=name)
    _, verdict = parsers.encode([skewed], record, name=name, max_error_px=100)
    assert verdict.outcome is Fidelity.REFITTED
    assert verdict.max_px > 1
    assert "skew of -23.1 px" in verdict.dropped


@pytest.mark.parametrize(("record", "name"), WRITTEN)
def test_fx_and_fy_are_kept_apart_or_refused(record: Format, name: str) -> None:
    item = a_camera_for(record)
    oblong = replace(item, intrinsics=replace(item.intrinsics, fx=3700.0, fy=3600.0))
    if capacity_of(record).two_focals:
        file, _ = parsers.encode([oblong], record, name=name)
        K = read_back(record, name, file)[0].intrinsics
        assert (K.fx, K.fy) == pytest.approx((3700.0, 3600.0), rel=1e-12)
        return
    if record.name in AFFINE_LENS:
        assert parsers.encode([oblong], record, name=name, max_error_px=0.5)[1].max_px < 0.5
        return
    with pytest.raises(UnsupportedModelError, match="px"):
        parsers.encode([oblong], record, name=name)


@pytest.mark.parametrize(("record", "name"), WRITTEN)
def test_several_cameras_come_back_in_order_or_are_refused(record: Format, name: str) -> None:
    item = a_camera_for(record)
    pair = [
        replace(item, camera=CameraKey(image_size=SIZE, sub_camera=side), intrinsics=K)
        for side, K in (
            ("right", item.intrinsics),
            ("left", replace(item.intrinsics, fx=3333.3, fy=3333.3)),
        )
    ]
    if not capacity_of(record).several_cameras:
        with pytest.raises(UnsupportedModelError, match="one camera"):
            parsers.encode(pair, record, name=name)
        return
    file, verdict = parsers.encode(pair, record, name=name)
    assert verdict.outcome is Fidelity.EXACT
    copies = read_back(record, name, file)
    assert [round(copy.intrinsics.fx, 6) for copy in copies] == [3650.1, 3333.3]
    assert all(copy.camera.sub_camera for copy in copies)


@pytest.mark.parametrize(("record", "name"), WRITTEN)
def test_what_a_file_has_no_place_for_is_named(record: Format, name: str) -> None:
    item = a_camera_for(record)
    known = replace(
        item, camera=replace(item.camera, firmware="01.02.0304", make="Acme"), grade=Grade.DERIVED
    )
    file, verdict = parsers.encode([known], record, name=name)
    [copy] = read_back(record, name, file)
    assert ("firmware" in verdict.dropped) == (copy.camera.firmware is None)
    assert ("make" in verdict.dropped) == (copy.camera.make is None)
    assert any(lost.startswith("grade") for lost in verdict.dropped) == (copy.grade is not Grade.DERIVED)
    assert ("image size" in verdict.dropped) == record.needs_image_size


@pytest.mark.parametrize(
    "record", [item for item in FORMATS if item.needs_image_size and item.write], ids=lambda item: item.name
)
def test_a_file_without_an_image_size_asks_for_it(record: Format) -> None:
    file = written(record, f"camera{record.suffixes[0]}")
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(file, name="camera", format=record)
