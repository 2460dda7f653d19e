"""A file's cameras that are made on demand: a list in every respect but when they are made."""

from __future__ import annotations

import pickle
import struct
from collections.abc import Sequence
from typing import Any

import pytest

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import ParseError
from calibrary.interop.colmap import COLMAP_MODELS, ColmapModel
from calibrary.parsers.formats import colmap as colmap_module
from calibrary.parsers.on_demand import FEW, CamerasOnDemand

SIZE = (5472, 3648)
NUMBERS = (3650.0, 3651.0, 2736.0, 1824.0, 0.01, 0.002, 1e-4, 2e-4)
COUNT = 500


def colmap(*changed: tuple[int, int, float]) -> bytes:
    """cameras.bin of OPENCV cameras; (camera, parameter, value) are changed."""
    table = [list(NUMBERS) for _ in range(COUNT)]
    for camera, parameter, value in changed:
        table[camera][parameter] = value
    rows = (struct.pack("<IiQQ8d", number + 1, 4, *SIZE, *row) for number, row in enumerate(table))
    return struct.pack("<Q", COUNT) + b"".join(rows)


def bundle(*focals: float) -> bytes:
    pose = "1 0 0\n0 1 0\n0 0 1\n0 0 0\n"
    rows = "".join(f"{f} -0.01 0.02\n{pose}" for f in focals)
    return f"# Bundle file v0.3\n{len(focals)} 0\n{rows}".encode()


def nvm(*focals: float) -> bytes:
    rows = "".join(f"{index}.jpg {f} 1 0 0 0 1 2 3 -0.01 0\n" for index, f in enumerate(focals))
    return f"NVM_V3\n\n{len(focals)}\n{rows}\n0\n".encode()


def many(name: str) -> Sequence[Calibration]:
    if name == "cameras.bin":
        return parsers.decode(colmap(), name=name)
    data = (bundle if name == "bundle.out" else nvm)(*(3650.0 + index for index in range(COUNT)))
    return parsers.decode(data, name=name, image_size=SIZE)


def test_reading_makes_no_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    original = colmap_module._calibration

    def counted(found: Sequence[colmap_module.StoredCamera], place: int, **named: Any) -> Calibration:
        made.append(found[place].place)
        return original(found, place, **named)

    monkeypatch.setattr(colmap_module, "_calibration", counted)
    cameras = parsers.decode(colmap(), name="cameras.bin")
    assert len(cameras) == COUNT
    assert not made
    assert cameras[7].camera.sub_camera == "8"
    assert made == [f"camera 8 of {COUNT}"]


def test_cameras_alike_are_what_each_is_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every model, with coefficients and without, with one focal length and two."""
    rows: list[bytes] = []
    for model in COLMAP_MODELS:
        for zeros in range(model.count - model.focals - 1):
            for f in (3650.25, 3651.5):
                lens = [
                    0.0 if at < zeros else 0.001 * (at + 1) for at in range(model.count - model.focals - 2)
                ]
                focals = [3650.25, f][: model.focals]
                for centre in (2736.5, 2701.0):
                    numbers = (*focals, centre, 1824.0, *lens)
                    head = struct.pack("<IiQQ", len(rows) + 3, model.number, 5472 + len(rows), 3648)
                    rows.append(head + struct.pack(f"<{model.count}d", *numbers))
    data = struct.pack("<Q", len(rows)) + b"".join(rows)
    found = parsers.decode(data, name="cameras.bin")
    assert isinstance(found, CamerasOnDemand)
    monkeypatch.setattr(colmap_module, "FEW", len(rows) + 1)
    alone = parsers.decode(data, name="cameras.bin")
    assert isinstance(alone, list)
    assert [repr(item) for item in found] == [repr(item) for item in alone]
    assert [item.project([[0.1, 0.2, 1.0]]).tolist() for item in found] == [
        item.project([[0.1, 0.2, 1.0]]).tolist() for item in alone
    ]


@pytest.mark.parametrize("model", COLMAP_MODELS, ids=lambda model: model.name)
@pytest.mark.parametrize("target", ["colmap_binary", "colmap_text"])
def test_columns_are_written_and_read_as_each_camera_is_by_itself(
    model: ColmapModel, target: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one focal length and two, and with each of the coefficients zero."""
    rows: list[bytes] = []
    for at in range(FEW + model.count):
        lens = [0.001 * (term + 1) if (at + term) % 3 else 0.0 for term in range(len(model.coefficients))]
        numbers = (*(3650.25, 3650.25 + at % 2)[: model.focals], 2736.5 + at, 1824.0, *lens)
        head = struct.pack("<IiQQ", 2 * at + 3, model.number, 5472 + at, 3648)
        rows.append(head + struct.pack(f"<{model.count}d", *numbers))
    found = parsers.decode(struct.pack("<Q", len(rows)) + b"".join(rows), name="cameras.bin")
    assert isinstance(found, CamerasOnDemand)
    data, verdict = parsers.encode(found, target)
    assert (data, verdict) == parsers.encode(list(found), target)
    assert parsers.encode(found[3:-1], target) == parsers.encode(list(found)[3:-1], target)
    name = "cameras.bin" if target == "colmap_binary" else "cameras.txt"
    again = parsers.decode(data, name=name)
    monkeypatch.setattr(colmap_module, "FEW", len(rows) + 1)
    assert [repr(item) for item in again] == [repr(item) for item in parsers.decode(data, name=name)]


def test_writing_makes_one_camera_of_a_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    cameras = parsers.decode(colmap((3, 4, 0.0)), name="cameras.bin")
    made: list[int] = []
    original = colmap_module._Alike.__call__

    def counted(self: colmap_module._Alike, place: int) -> Calibration:
        made.append(place)
        return original(self, place)

    monkeypatch.setattr(colmap_module._Alike, "__call__", counted)
    assert parsers.encode(cameras, "colmap_binary")[0] == colmap((3, 4, 0.0))
    assert sorted(made) == [0, 0, 3, 3]


def test_a_line_unlike_the_others_is_named_where_it_is() -> None:
    lines = [f"{number} OPENCV 5472 3648 {' '.join(map(str, NUMBERS))}" for number in range(1, 41)]
    lines[30] = lines[30].replace("3650.0", "3_650")
    with pytest.raises(ParseError, match=r"line 33: '3_650' is not a number"):
        parsers.decode("\n".join(["# cameras", "", *lines, ""]).encode(), name="cameras.txt")


@pytest.mark.parametrize("name", ["cameras.bin", "bundle.out", "scene.nvm"])
def test_they_are_a_list_of_cameras(name: str) -> None:
    cameras = many(name)
    assert isinstance(cameras, CamerasOnDemand)
    whole = list(cameras)
    assert len(cameras) == len(whole) == COUNT
    assert cameras == whole
    assert cameras != whole[:-1]
    assert cameras != whole[::-1]
    assert cameras[-1] == whole[-1]
    assert cameras[3:9:2] == whole[3:9:2]
    assert whole[5] in cameras
    assert cameras.index(whole[5]) == 5
    assert pickle.loads(pickle.dumps(cameras)) == whole  # noqa: S301  made two calls ago
    with pytest.raises(IndexError):
        cameras[COUNT]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ((3, 0, float("nan")), "camera 4 of 500: a parameter is not finite"),
        ((3, 7, float("inf")), "camera 4 of 500: a parameter is not finite"),
        ((3, 1, -3650.0), "camera 4 of 500: focal lengths are 3650 and -3650 px, expected positive ones"),
        ((3, 2, 1e13), "camera 4: its K, with fx 3650"),
        ((3, 0, 1e-9), "camera 4: its K, with fx 1e-09"),
    ],
)
def test_one_that_cannot_be_made_refuses_the_file_when_it_is_read(
    change: tuple[int, int, float], said: str
) -> None:
    with pytest.raises(ParseError) as caught:
        parsers.decode(colmap(change), name="cameras.bin")
    assert said in str(caught.value)


def test_so_it_is_with_a_focal_length_alone() -> None:
    for data, name in (
        (bundle(3650.0, 1e14), "bundle.out"),
        (nvm(3650.0, 1e14), "a.nvm"),
    ):
        with pytest.raises(ParseError, match=r"its K, with fx 1e\+14"):
            parsers.decode(data, name=name, image_size=SIZE)
