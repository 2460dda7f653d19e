"""An entry's file: one writer, and a reader that lets nothing through that could mean two things."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary.distortion import NoDistortion
from calibrary.errors import InputError, ParseError
from calibrary.quality import Quality
from calibrary.registry.entry import UNSTATED, Alias, Entry, Sensor, Status, digest
from calibrary.registry.entry_yaml import LARGEST_ENTRY, block, entry_yaml, number, parse_entry, quoted
from calibrary.registry.firmware import FirmwareRange
from calibrary.schemas import require
from calibrary.strictyaml import load_yaml
from tests.registry.entries import a_content, covariance, entries, texts
from tests.thorough import examples

FIRST_CUT = """\
schema: calibrary/entry-1
camera: {make: DJI, model: FC6310R, image_size: [5472, 3648], firmware: "01.09"}
intrinsics: {pixel_origin: corner, fx: 3660.5, fy: 3655.25, cx: 2731.5, cy: 1846.75}
distortion: {model: brown, k1: -0.268, k2: 0.112, p1: 0.0008, p2: -0.0001, k3: -0.034}
grade: calibrated
notes: from the lab
"""


def text_of(entry: Entry) -> str:
    return entry_yaml(entry).decode()


def changed(pattern: str, replacement: str, entry: Entry | None = None) -> bytes:
    """An entry's file with one place edited by hand."""
    text, count = re.subn(pattern, replacement, text_of(entry or a_content()), count=1, flags=re.MULTILINE)
    assert count == 1
    return text.encode()


@settings(max_examples=examples(12))
@given(entries())
def test_the_file_gives_the_entry_back_bit_for_bit(entry: Entry) -> None:
    data = entry_yaml(entry)
    again = parse_entry(data, "x.yaml")
    assert again == entry
    assert entry_yaml(again) == data


@settings(max_examples=examples(12))
@given(entries())
def test_what_is_written_keeps_to_the_schema_and_other_readers_read_the_same(entry: Entry) -> None:
    data = entry_yaml(entry)
    document = load_yaml(data, source="x.yaml")
    require(document, "entry-1")
    assert json.dumps(yaml.load(data, yaml.CSafeLoader)) == json.dumps(document)
    assert b"\r" not in data


def test_the_file_explains_itself_and_keeps_its_order() -> None:
    covered = Quality(rms_px=0.31, covariance=covariance())
    entry = a_content(quality=covered, aliases=(Alias(make="Hasselblad", model="L1D"),), tolerance=0.01)
    lines = text_of(entry).splitlines()
    legend = " ".join(line.removeprefix("#").strip() for line in lines if line.startswith("#"))
    for word in (
        "pixels",
        "outer corner of the top-left pixel",
        "take 0.5 off",
        "no part of K",
        "registry add",
    ):
        assert word in legend
    keys = [line.partition(":")[0] for line in lines if re.match(r"\w", line)]
    assert keys == [
        "schema", "digest", "camera", "intrinsics", "distortion", "grade", "quality", "provenance",
        "aliases", "tolerance",
    ]  # fmt: skip


def test_a_change_of_one_number_changes_its_line_and_the_digest() -> None:
    before, after = text_of(a_content()).splitlines(), text_of(a_content(fx=3661.5)).splitlines()
    differ = [
        line.partition(":")[0].strip() for line, other in zip(before, after, strict=True) if line != other
    ]
    assert differ == ["digest", "fx", "fy"]


def test_unknown_distortion_is_not_none() -> None:
    assert "distortion: null" in text_of(a_content(distortion=None))
    assert (
        parse_entry(entry_yaml(a_content(distortion=NoDistortion())), "x").calibration.distortion
        == NoDistortion()
    )


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_is_the_same_double_to_every_reader(value: float) -> None:
    text = number(value)
    loaded: tuple[Any, ...] = (
        yaml.load(text, yaml.CSafeLoader),
        load_yaml(text, source="x"),
        json.loads(text),
        float(text),
    )
    assert [float(each).hex() for each in loaded] == [value.hex()] * 4
    assert all(isinstance(each, float) for each in loaded)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_what_is_no_number_is_never_written(value: float) -> None:
    with pytest.raises(InputError, match="finite"):
        number(value)


@given(texts())
def test_a_string_is_the_same_to_every_reader_and_one_printable_line(text: str) -> None:
    written = quoted(text)
    assert yaml.load(written, yaml.CSafeLoader) == load_yaml(written, source="x") == text
    assert written.isprintable()


@pytest.mark.parametrize(
    "text", ["NO", "1e-05", "017", "12:30:45", "1.10", "null", "2026-05-01", "=", "<<", ""]
)
def test_a_string_that_looks_like_something_else_stays_one(text: str) -> None:
    assert yaml.load(quoted(text), yaml.CSafeLoader) == text
    assert yaml.load("\n".join(block(text, text)), yaml.CSafeLoader) == {text: text}


def test_a_lone_surrogate_is_refused_when_writing() -> None:
    with pytest.raises(InputError, match="surrogate"):
        entry_yaml(a_content(make="DJI\ud83d"))


@pytest.mark.parametrize(
    "key", ["x-fleet", "camera/x-mount", "provenance/x-rig", "quality/x-board", "sensor/x-a"]
)
def test_fields_of_others_are_kept_as_they_are_however_deep(key: str) -> None:
    fields: dict[str, Any] = {key: {"no": [1, 2.5, {"deep": [[None, True], "017"]}], "empty": {}}}
    entry = a_content(quality=Quality(rms_px=0.3), sensor=Sensor(width_mm=13.2), extensions=fields)
    again = parse_entry(entry_yaml(entry), "x")
    assert again.extensions == fields
    assert again == entry


@pytest.mark.parametrize("key", ["fleet", "sensor/x-a", "intrinsics/x-a", "a/b/x-c"])
def test_a_field_that_the_file_has_no_place_for_is_refused(key: str) -> None:
    with pytest.raises(InputError, match="not a field of this entry"):
        a_content(extensions={key: 1})


def test_an_x_field_deeper_than_a_file_may_be_is_refused() -> None:
    deep: Any = 1
    for _ in range(40):
        deep = [deep]
    with pytest.raises(InputError, match="deep"):
        entry_yaml(a_content(extensions={"x-deep": deep}))


@pytest.mark.parametrize(
    ("pattern", "replacement"),
    [
        (r"^  fx: .*", "  fx: 3700.0"),
        (r"^  k1: .*", "  k1: -0.3"),
        (r"^  model: \"brown\"", '  model: "off-centre-brown"'),
        (r"^  image_size: .*", "  image_size: [5472, 3646]"),
        (r"^(grade:)", r"sensor: {width_mm: 13.2}\n\1"),
    ],
)
def test_a_number_changed_by_hand_is_found_out_and_the_way_out_named(pattern: str, replacement: str) -> None:
    with pytest.raises(ParseError, match=r"x\.yaml: digest: .*registry add FILE") as caught:
        parse_entry(changed(pattern, replacement), "x.yaml")
    assert "Traceback" not in str(caught.value)
    # What has no digest has none to break: the hand that took it out answers for the numbers.
    without = re.sub(rb"(?m)^digest.*\n", b"", changed(pattern, replacement))
    parse_entry(without, "x.yaml", require_digest=False)


@pytest.mark.parametrize(
    ("pattern", "replacement"),
    [
        (r"^  fx: (\S+)", r"  fx: +0\1e0"),
        (r"^(  fx: .*)\n(  fy: .*)", r"\2\n\1"),
        (r"^(grade: .*)", r"\1\nnotes: [looked at again]"),
    ],
)
def test_what_is_no_number_or_only_spelt_otherwise_needs_no_new_digest(
    pattern: str, replacement: str
) -> None:
    data = changed(pattern, replacement)
    assert parse_entry(data.replace(b"+0", b"+"), "x.yaml").calibration.intrinsics.fx == 3661.25


def test_crlf_line_ends_are_read_alike() -> None:
    assert parse_entry(entry_yaml(a_content()).replace(b"\n", b"\r\n"), "x") == a_content()


def test_a_byte_order_mark_is_read_over_and_utf_16_is_refused() -> None:
    entry = a_content()
    data = entry_yaml(entry)
    assert parse_entry(b"\xef\xbb\xbf" + data, "x.yaml") == entry
    for encoding in ("utf-16", "utf-16-be"):
        mark = b"" if encoding == "utf-16" else b"\xfe\xff"
        with pytest.raises(ParseError, match="UTF-16"):
            parse_entry(mark + data.decode().encode(encoding), "x.yaml")


def test_a_file_without_a_digest_is_read_only_where_none_is_asked_for() -> None:
    bare = changed(r"^digest: .*\n", "")
    assert parse_entry(bare, "x", require_digest=False) == a_content()
    with pytest.raises(ParseError, match="registry add FILE"):
        parse_entry(bare, "x")


def test_a_file_of_the_first_cut_is_read_and_written_anew_as_a_whole() -> None:
    old = parse_entry(FIRST_CUT.encode(), "old.yaml", require_digest=False)
    assert old.firmware == FirmwareRange(min="01.09", max="01.09")
    assert old.notes == ("from the lab",)
    assert (old.status, old.calibration.provenance) == (Status.DRAFT, UNSTATED)
    new = entry_yaml(old)
    assert parse_entry(new, "new.yaml") == old
    assert digest(old.calibration) in new.decode()
    explicit = FIRST_CUT.replace("entry-1", "entry-0").encode()
    assert parse_entry(explicit, "old.yaml", require_digest=False) == old


@pytest.mark.parametrize("version", [2, 12])
def test_a_newer_schema_is_refused_with_what_was_found_and_what_to_do(version: int) -> None:
    data = changed("calibrary/entry-1", f"calibrary/entry-{version}")
    with pytest.raises(ParseError, match=rf"cameras/a\.yaml: schema: .*version {version}.*up to 1.*upgrade"):
        parse_entry(data, "cameras/a.yaml")


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        (r"^schema: .*", "schema: pix4d", "is this a registry's entry"),
        (r"^schema: .*\n", "", "is this a registry's entry"),
        (r"^  fx: .*", "  fx: .nan", "line 15.*not a finite number"),
        (r"^  fx: .*", "  fx: 1e400", "not a finite number"),
        (r"^  fx: .*", "  fx: 017", "octal"),
        (r"^  fx: .*", "  fx: 1_000.5", "expected a number"),
        (r"^  fx: .*", "  fx: 12:30:45", "expected a number"),
        (r"^  fx: .*", "  fx: 1,5", "expected a number"),
        (r"^  fx: .*", "  fx: true", "expected a number"),
        (r"^  fx: .*", "  fx: -1.0", "more than 0"),
        (r"^  fx: (.*)", r"  fx: \1\n  fx: \1", "duplicate key"),
        (r"^  fx: .*", "  fx: &a 3661.25", "anchor"),
        (r"^  fx: .*", "  fx: !!float 3661.25", "tag"),
        (r"^  cx: .*\n", "", "lacks cx"),
        (r"^  make: .*", "  make: NO1\n  serial: 0012345", "quote it"),
        (r"^  make: .*", "  make: 1.10", "quote it"),
        (r"^  image_size: .*", "  image_size: [5472.0, 3648]", "a whole number"),
        (r"^  pixel_origin: .*", "  pixel_origin: centre", "expected 'corner'"),
        (r"^  k2: .*\n", "", "lacks k2"),
        (r"^  k2: (.*)", r"  k2: \1\n  k7: 0.1", "'k7' is not a valid key"),
        (r"^  k2: (.*)", r"  k2: \1\n  fx: 0.1", "'fx' is not a valid key"),
        (r"^  model: \"brown\"", '  model: "own"', "'own', expected"),
        (r"^grade: .*", "grade: seed", "'seed', expected"),
        (r"^  sha256: .*", "  sha256: null", "text"),
        (r"^  sha256: .*", "  sha256: abc", "matches"),
        (r"^  sha256: .*\n", "", "lacks sha256"),
        (r"^(grade: .*)", r"\1\nvalidity: {from: 2026-02-30}", "not a day of the calendar"),
        (r"^(grade: .*)", r"\1\nquality: {covariance: {names: [fx], upper: [1.0, 2.0]}}", "1 numbers"),
        (r"^(grade: .*)", r"\1\nfocal: 3", "'focal' is not a valid key"),
        (r"(?s)\A.*\Z", "", "no YAML value"),
        (r"(?s)\A.*\Z", "- 1", "not a map"),
        (r"(?s)\A.*\Z", "[" * 30_000, "deep"),
    ],
)
def test_a_trap_is_an_error_that_names_the_file(pattern: str, replacement: str, message: str) -> None:
    with pytest.raises(InputError, match=f"(?s)cameras/a.yaml: .*{message}"):
        parse_entry(changed(pattern, replacement), "cameras/a.yaml")


def test_a_file_of_unreasonable_size_is_not_looked_at() -> None:
    with pytest.raises(ParseError, match="bytes"):
        parse_entry(b"#" * (LARGEST_ENTRY + 1), "x.yaml")
