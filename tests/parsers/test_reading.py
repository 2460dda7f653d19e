"""Opening, recognising and discovering: what is refused, and in which words."""

from __future__ import annotations

import gzip
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from calibrary import parsers
from calibrary.errors import (
    AmbiguousFormatError,
    InputError,
    ParseError,
    UnknownFormatError,
    UnsupportedModelError,
)
from calibrary.parsers import discovery, reading
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin
from calibrary.parsers.discovery import format_named
from calibrary.parsers.files import companions
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.refused import REFUSED
from calibrary.records import replace
from tests.parsers.cameras import BROWN, SIZE, camera

CALIBRATION = parsers.encode([camera(BROWN)], "agisoft_xml")[0]
Install = Callable[..., None]


def claiming(name: str, sure: Sure, suffix: str = ".cal", **more: Any) -> Format:
    """A format that claims everything."""
    arguments: dict[str, Any] = {
        "convention": Convention(origin=Origin.CORNER),
        "read": lambda _data, _context: [camera()],
    }
    return Format(
        name=name,
        title=name.title(),
        suffixes=(suffix,),
        reference="https://example.org",
        sniff=lambda _content: Sniff(sure, f"{name} says so"),
        **(arguments | more),
    )


@pytest.fixture
def only(monkeypatch: pytest.MonkeyPatch) -> Install:
    """Let just the given formats be known."""

    def install(*records: Format) -> None:
        monkeypatch.setattr(reading, "known_formats", lambda: {record.name: record for record in records})
        monkeypatch.setattr(
            reading,
            "formats_of",
            lambda syntax: [record for record in records if syntax in record.syntaxes],
        )

    return install


@pytest.fixture
def calibration_file(tmp_path: Path) -> Path:
    path = tmp_path / "camera.yml"
    parsers.write([camera()], path, "opencv_storage")
    return path


def test_what_is_written_to_a_file_is_read_from_it(calibration_file: Path) -> None:
    [copy] = parsers.read(calibration_file)
    assert (copy.intrinsics, copy.distortion) == (camera().intrinsics, BROWN)
    assert copy.provenance.source == "camera.yml"
    assert parsers.identify(str(calibration_file)).format.name == "opencv_storage"


def test_the_name_of_a_file_says_nothing_about_its_format(calibration_file: Path) -> None:
    moved = calibration_file.rename(calibration_file.with_name("camera.npy"))
    assert parsers.identify(moved).format.name == "opencv_storage"


def test_a_refused_write_leaves_the_old_file(calibration_file: Path) -> None:
    before = calibration_file.read_bytes()
    with pytest.raises(UnsupportedModelError):
        parsers.write([camera(skew=-23.1)], calibration_file, "opencv_storage")
    assert calibration_file.read_bytes() == before
    assert list(calibration_file.parent.iterdir()) == [calibration_file]


def test_two_equal_claims_are_an_error_that_names_both(only: Install) -> None:
    only(claiming("alpha", Sure.SHAPE), claiming("beta", Sure.SHAPE), claiming("gamma", Sure.WEAK))
    with pytest.raises(AmbiguousFormatError, match=r"alpha \(alpha says so\) and beta \(beta says so\)"):
        parsers.decode(b"x", name="x.cal")


def test_the_strongest_claim_wins(only: Install) -> None:
    only(claiming("alpha", Sure.SHAPE), claiming("beta", Sure.MAGIC))
    assert reading.identified(Content(b"x", "x")).format.name == "beta"


def test_a_suffix_parts_two_weak_claims_and_no_others(only: Install) -> None:
    only(claiming("alpha", Sure.WEAK), claiming("beta", Sure.WEAK, ".txt"))
    assert reading.identified(Content(b"x", "x.TXT")).format.name == "beta"
    only(claiming("alpha", Sure.SHAPE), claiming("beta", Sure.SHAPE, ".txt"))
    with pytest.raises(AmbiguousFormatError):
        reading.identified(Content(b"x", "x.txt"))


def test_a_weak_claim_is_noted_on_the_calibration(only: Install) -> None:
    only(claiming("alpha", Sure.WEAK))
    assert "nothing in the file says that it is Alpha" in parsers.decode(b"x", name="x")[0].notes[0]


def test_a_format_that_is_only_recognised_is_refused_with_its_way_out(only: Install) -> None:
    only(claiming("calcam", Sure.MAGIC, read=None, convention=None, refuses="export Agisoft XML instead"))
    with pytest.raises(UnsupportedModelError, match="this is Calcam: export Agisoft XML instead"):
        parsers.decode(b"x", name="x.cal")


@pytest.mark.parametrize(
    "record", [record for record in parsers.formats() if record.refuses], ids=lambda r: r.name
)
def test_a_refusal_says_what_the_file_is_in_a_sentence(record: Format) -> None:
    """It becomes "this is …"."""
    assert record.title.split()[0] in {"a", "an"}


@pytest.mark.parametrize("text", ['{"a": 1}', '[{"a": 1}]', "[ 1, 2]", "[", "[]", "[-1]", '["a"]', "[true]"])
def test_objects_and_arrays_look_like_json(text: str) -> None:
    assert Content(text.encode(), "a").looks_like_json


@pytest.mark.parametrize("text", ["[image]\nwidth\n5472", "[narrow_stereo/left]", "[trueColour]", "cam0: {}"])
def test_sections_of_ini_files_do_not(text: str) -> None:
    assert not Content(text.encode(), "a").looks_like_json


def test_cameras_that_do_not_all_read_back_are_refused() -> None:
    record = format_named("opencv_storage")
    whole = record.read
    assert whole is not None
    forgetful = replace(record, read=lambda data, context: whole(data, context)[:1])
    with pytest.raises(UnsupportedModelError, match="2 cameras reads back as 1"):
        parsers.encode([camera(None), camera(None)], forgetful)


def test_a_number_that_makes_no_lens_is_the_files_fault(only: Install) -> None:
    def read(_data: bytes, _context: ReadContext) -> list[object]:
        raise InputError("k1 is nan, expected a finite number", place="k1")

    only(claiming("alpha", Sure.MAGIC, read=read))
    with pytest.raises(ParseError, match=r"^x\.cal: k1: k1 is nan"):
        parsers.decode(b"x", name="x.cal")


def test_a_file_without_cameras_is_broken(only: Install) -> None:
    only(claiming("alpha", Sure.MAGIC, read=lambda _d, _c: []))
    with pytest.raises(ParseError, match="contains no camera"):
        parsers.decode(b"x", name="x.cal")


FILE = (
    "cam_model: Pinhole\ncam_width: 640\ncam_height: 480\n"
    "cam_fx: 501.25\ncam_fy: 500.5\ncam_cx: 320.1\ncam_cy: 240.2\ncam_d0: "
)


def test_a_last_number_of_as_many_decimals_as_any_other_is_taken_with_a_note() -> None:
    [item] = parsers.decode(f"{FILE}-0.11".encode(), name="camera.yaml")
    assert item.distortion == parsers.decode(f"{FILE}-0.11\n".encode(), name="camera.yaml")[0].distortion
    assert "'-0.11', was taken as it stands" in item.notes[-1]


@pytest.mark.parametrize("last", ["-0.1", "-0.00", "-1", "-1.25e-1"])
def test_a_last_number_that_may_lack_digits_is_refused(last: str) -> None:
    with pytest.raises(ParseError, match="the last line is not ended"):
        parsers.decode(f"{FILE}{last}".encode(), name="camera.yaml")


def test_a_merge_of_git_that_was_not_resolved_is_named_with_its_lines() -> None:
    ours, theirs = "fx = 812.5\n", "fx = 822.5\n"
    text = f"cx = 320\n<<<<<<< HEAD\n{ours}=======\n{theirs}>>>>>>> theirs\ncy = 240\n"
    with pytest.raises(ParseError, match="lines 2 to 6: an unresolved merge of git"):
        parsers.decode(text.encode(), name="camera.txt")


def test_a_file_beyond_a_limit_is_not_called_cut_short() -> None:
    rows = "".join(f"omc_{number} = [ 1.5 ; 2.5 ; 3.5 ];\n" for number in range(70_000))
    with pytest.raises(ParseError, match="it is over 2 MiB, the most that is read") as refusal:
        parsers.decode(
            f"fc = [ 500 ; 500 ];\nkc = [ 0 ; 0 ];\n{rows}nx = 640".encode(), name="Calib_Results.m"
        )
    assert "cut short" not in str(refusal.value)


def test_an_unknown_file_is_shown_by_its_beginning() -> None:
    with pytest.raises(UnknownFormatError, match='begins with "hello"'):
        parsers.decode(b"\n hello\nworld", name="x.txt")


def test_broken_json_is_said_to_be_that() -> None:
    with pytest.raises(UnknownFormatError, match=r"this is not JSON: .* at line 1; it may be cut short"):
        parsers.decode(b'{"camera_matrix": [1, 2', name="x.json")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (
            gzip.compress(b"camera_matrix: 1", mtime=0),
            r"compressed with gzip; decompress it first \(gunzip\)",
        ),
        (b"PK\x03\x04\x14\0\0\0", "a ZIP archive; unpack it"),
        (b"PK\x03\x04\x14\0\0\0foo.npy", "numpy arrays, 'foo', and none has a camera matrix's name"),
        (b"%PDF-1.7\n", "a PDF; export the calibration"),
        (
            b"\n<!DOCTYPE html>\n<html><title>404</title></html>\n",
            "an HTML page, .* download the file itself",
        ),
        (b"<html>\n<body>403</body></html>\n", "an HTML page"),
        (b"  \n\n", "it is blank; export or copy it again"),
    ],
)
def test_a_file_that_is_something_else_comes_with_the_next_step(data: bytes, said: str) -> None:
    with pytest.raises(UnknownFormatError, match=said) as caught:
        parsers.decode(data, name="calib.xml")
    assert "--format" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"colour": "red"}, "asks nothing called 'colour'; it knows unit, origin, y_axis, distortion"),
        ({"distortion": "odd"}, "brown, fisheye"),
    ],
)
def test_an_option_the_format_does_not_know_is_refused(
    calibration_file: Path, options: dict[str, str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        parsers.read(calibration_file, options=options)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("opnecv", r"'opnecv'; did you mean opencv or openmvg\? 'calibrary formats' lists them all"),
        ("Metashape XML", "did you mean metashape or "),
        ("matlab", "did you mean matlab_json or matlab_mat"),
        ("xy", "there is no format 'xy'; 'calibrary formats' lists them all"),
    ],
)
def test_a_format_that_does_not_exist_is_refused_with_similar_names(
    calibration_file: Path, name: str, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        parsers.read(calibration_file, format=name)


@pytest.mark.parametrize("limit", [-1.0, float("nan"), float("inf")])
def test_an_error_limit_is_a_number_of_pixels(limit: float) -> None:
    with pytest.raises(InputError, match="--max-error-px"):
        parsers.encode([camera()], "opencv_storage", max_error_px=limit)


def test_nothing_is_not_written() -> None:
    with pytest.raises(InputError, match="no calibration"):
        parsers.encode([], "opencv_storage")


def test_a_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a directory"):
        parsers.read(tmp_path)


def test_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="a named pipe"):
        parsers.identify(tmp_path / "pipe")


def test_a_device_is_refused() -> None:
    with pytest.raises(InputError, match="a device"):
        parsers.read("/dev/zero")


def test_a_socket_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # the path of a socket is short
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
        with pytest.raises(InputError, match="a socket"):
            parsers.read("socket")


def test_a_loop_of_links_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(InputError, match="cannot be read"):
        parsers.read(tmp_path / "a")


def test_a_link_to_a_file_is_followed(calibration_file: Path) -> None:
    link = calibration_file.with_name("link")
    link.symlink_to(calibration_file)
    assert parsers.read(link)[0].provenance.source == "link"


@pytest.mark.parametrize("name", ["nothing.xml", "nul\0.xml", "x" * 300])
def test_a_file_that_cannot_be_opened_is_an_input_error(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        parsers.read(tmp_path / name)


def test_an_empty_file_is_named_so(tmp_path: Path) -> None:
    (tmp_path / "a.xml").touch()
    with pytest.raises(ParseError, match="empty"):
        parsers.read(tmp_path / "a.xml")


def test_a_file_past_the_limit_is_not_taken_in(calibration_file: Path) -> None:
    with pytest.raises(ParseError, match="longer than 100 bytes"):
        parsers.read(calibration_file, max_bytes=100)


def test_a_git_lfs_pointer_is_named_so(tmp_path: Path) -> None:
    pointer = tmp_path / "a.xml"
    pointer.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n")
    with pytest.raises(ParseError, match="git lfs pull"):
        parsers.read(pointer)


def test_a_name_that_cannot_be_printed_is_escaped(tmp_path: Path) -> None:
    (tmp_path / "a\x1b[31m.xml").write_bytes(b"x")
    with pytest.raises(UnknownFormatError) as caught:
        parsers.read(tmp_path / "a\x1b[31m.xml")
    assert str(caught.value).startswith(r"a\x1b[31m.xml: ")


def test_a_companion_lies_beside_the_file_and_nowhere_else(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "b.json").write_bytes(b"{}")
    companion = companions(tmp_path / "a.json")
    assert companion("sub/b.json") == b"{}"
    assert companion("c.json") is None
    for outside in ("../a", "/etc/passwd", "..\\a", "sub/../../a", "", "a\0"):
        with pytest.raises(ParseError, match="not a file beside it"):
            companion(outside)
    with pytest.raises(ParseError, match=r"'xxx.*…, which cannot be looked up"):
        companion("x" * 5000)


@pytest.mark.parametrize("syntax", Syntax)
def test_a_file_is_asked_about_by_every_format_of_its_syntax(syntax: Syntax) -> None:
    every = [
        record
        for record in discovery.known_formats().values()
        if syntax in record.syntaxes and record.name != discovery.BY_HAND
    ]
    assert [record.name for record in discovery.formats_of(syntax)] == [record.name for record in every]


def test_the_formats_of_some_syntaxes_are_those_that_say_so() -> None:
    """A format that is missing in the table is loaded for every file, which a new one may be."""
    for syntaxes, names in discovery.ONLY.items():
        for module in names.split():
            every = map(discovery.format_named, discovery.FAMILIES.get(module, (module,)))
            assert {one for record in every for one in record.syntaxes} == set(syntaxes), module


@pytest.fixture
def plugins(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[EntryPoint]]:
    """The entry points other packages register."""
    points: list[EntryPoint] = []
    monkeypatch.setattr(
        "importlib.metadata.entry_points", lambda group: points if group == discovery.GROUP else []
    )
    remembered = (discovery.known_formats, discovery.formats_of, discovery._not_built_in)
    for function in remembered:
        function.cache_clear()
    yield points
    for function in remembered:
        function.cache_clear()


def point(monkeypatch: pytest.MonkeyPatch, name: str, target: object) -> EntryPoint:
    module = type(sys)(f"plugin_{name}")
    vars(module)["FORMAT"] = target
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return EntryPoint(name, f"{module.__name__}:FORMAT", discovery.GROUP)


def test_another_packages_format_joins(plugins: list[EntryPoint], monkeypatch: pytest.MonkeyPatch) -> None:
    plugins.append(point(monkeypatch, "a", claiming("house_format", Sure.WEAK)))
    assert [record.name for record in parsers.formats()] == sorted(
        [
            "agisoft_xml",
            "house_format",
            *(name for name in discovery._modules() if name != "agisoft_xml"),
            *discovery._rows(),
            *(record.name for record in REFUSED),
        ]
    )
    assert parsers.decode(b"anything", name="x", format="house_format")


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (claiming("agisoft_xml", Sure.WEAK), "which is taken"),
        ("no format", "is not a .*Format"),
        (None, "cannot be loaded"),
    ],
)
def test_a_bad_plugin_is_left_out_with_a_warning(
    plugins: list[EntryPoint], monkeypatch: pytest.MonkeyPatch, target: object, message: str
) -> None:
    broken = EntryPoint("a", "no_such_module_anywhere:FORMAT", discovery.GROUP)
    plugins.append(broken if target is None else point(monkeypatch, "a", target))
    with pytest.warns(RuntimeWarning, match=message):
        assert "agisoft_xml" in [record.name for record in parsers.formats()]


def test_a_record_must_be_whole() -> None:
    with pytest.raises(InputError, match="either read its files or say why"):
        claiming("alpha", Sure.WEAK, refuses="no")
    with pytest.raises(InputError, match="state its convention"):
        claiming("alpha", Sure.WEAK, convention=None)
    with pytest.raises(InputError, match="write, capacity and read together"):
        claiming("alpha", Sure.WEAK, write=lambda _c, _x: b"")


def test_importing_the_room_loads_no_format_and_nothing_heavy() -> None:
    code = (
        "import sys, calibrary.parsers; "
        "heavy = {'lxml', 'yaml', 'cv2', 'git', 'PIL', 'scipy', 'calibrary.parsers.formats.agisoft_xml'}; "
        "sys.exit(', '.join(sorted(heavy & set(sys.modules))) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_the_size_given_must_be_the_size_stated(calibration_file: Path) -> None:
    assert parsers.read(calibration_file, image_size=SIZE)
    with pytest.raises(InputError, match="leave it out"):
        parsers.read(calibration_file, image_size=(100, 100))


@pytest.mark.parametrize(
    ("name", "data", "is_one"),
    [
        ("frame.dat", b"\xff\xd8\xff\xe1", True),
        ("camera.json", b"{}", False),
        ("broken.jpg", b"{}", True),
        ("camera.jpg", CALIBRATION, False),
        ("notes.txt", b"nothing", False),
        ("gone.jpg", None, True),
        ("gone.yml", None, False),
    ],
)
def test_a_file_is_an_image_by_its_content_or_by_its_name_where_no_format_knows_it(
    tmp_path: Path, name: str, data: bytes | None, is_one: bool
) -> None:
    if data is not None:
        (tmp_path / name).write_bytes(data)
    assert parsers.is_image_file(tmp_path / name) is is_one
