"""Two people's whole jobs, by the commands alone and in empty directories: each ends in the right decision.

The integrator takes a payload on board; the engineer is asked whether a firmware update moved K. The keeper's day
is in ``test_keeper_walk.py``.
"""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import pytest

from calibrary.calib.board import Board
from calibrary.calib.corners_file import encode_corners
from calibrary.calib.synthesis import Settings
from calibrary.calib.synthesis.files import write_frames
from calibrary.calibration import Grade
from calibrary.cli.main import main
from calibrary.jobs.demo.flight import farmland
from calibrary.records import replace
from calibrary.registry.entry import Status
from calibrary.synthetic import ExifValue, Head
from tests.calib.solving import Session, camera, shoot
from tests.calib.staging import camera as staged
from tests.calib.staging import truth
from tests.cli.registry.fleets import held, looked_at, xml
from tests.imagery import ExifTags, write_jpeg
from tests.jobs.onboard.payloads import SURVEY
from tests.pages.sketches import sketched
from tests.registry.git.repositories import nobodys_git

__all__ = ["nobodys_git"]

FRAME = (1280, 960)
KEY = "example/survey_one"
BOARD_EXIF: dict[str, ExifValue] = {
    "Make": SURVEY["make"],
    "Model": SURVEY["model"],
    "Software": SURVEY["software"],
    "DateTimeOriginal": "2026:03:05 10:00:00",
    "FocalLength": SURVEY["focal_mm"],
    "FocalLengthIn35mmFilm": SURVEY["focal_35mm"],
    "BodySerialNumber": SURVEY["body_serial"],
    "FocalPlaneXResolution": SURVEY["focal_plane_resolution"][0],
    "FocalPlaneYResolution": SURVEY["focal_plane_resolution"][1],
    "FocalPlaneResolutionUnit": SURVEY["focal_plane_unit"],
}
"""The same camera before a board, by the names the synthesis writes it with."""


class Person:
    """Somebody at a terminal."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *words: str | Path, code: int = 0) -> str:
        """What a command says, on both streams."""
        with sketched():
            got = main([str(word) for word in words])
        said = self._capsys.readouterr()
        assert got == code, said.err + said.out
        return said.out + said.err


@pytest.fixture
def person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Person:
    monkeypatch.delenv("CALIBRARY_REGISTRY", raising=False)
    monkeypatch.chdir(tmp_path)
    return Person(capsys)


@pytest.fixture
def delivery(tmp_path: Path) -> Path:
    """What came with the payload: flight images, frames of a board, the maker's file and his letter."""
    folder, exif = tmp_path / "delivery", ExifTags(**SURVEY, date_time="2026:03:05 10:00:00")
    board = Board(columns=11, rows=8, square_mm=40)
    seen = truth(staged(), Settings(), count=16, seed=5, board=board)
    folder.mkdir()
    write_frames(folder / "DCIM" / "101", seen, 1, lambda _: Head(exif=BOARD_EXIF))
    for number in range(3):
        path = folder / "DCIM" / "100" / f"IMG_{number:04}.jpg"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_jpeg(path, FRAME, exif=exif, pixels=farmland(FRAME, seed=number), quality=80)
    xml(folder / "camera.xml", 968.0, FRAME, 4.3)
    (folder / "letter.txt").write_text("with kind regards")
    return folder


@pytest.mark.thorough
def test_an_integrator_takes_a_payload_on_board(person: Person, delivery: Path, tmp_path: Path) -> None:
    person("registry", "init", "fleet")
    flight = delivery / "DCIM" / "100"
    registry = ("--registry", "fleet")
    assert "no entry" in person("registry", "audit", flight, *registry, code=1)

    said = person("onboard", delivery, *registry, "--square-mm", "40", "--for", "unit", "--yes")
    assert "3 images of flights, 16 frames of a board, 1 calibration file, 2 skipped" in said
    assert "draft proposed" in said
    branch = "onboard/example-survey_one"
    page = (tmp_path / "onboard-example-survey_one.html").read_text()
    assert "checkerboard:11x8" in page

    # Nothing is used before somebody approves, and running it twice changes nothing.
    assert "no entry" in person("registry", "audit", flight, *registry, code=1)
    shutil.copytree("fleet", "before")
    assert "nothing new" in person(
        "onboard", delivery, *registry, "--square-mm", "40", "--for", "unit", "--yes"
    )
    assert _refs(Path("before")) == _refs(Path("fleet"))

    shown = looked_at(tmp_path / "fleet", KEY, rev=branch)
    person("registry", "approve", *shown, "--from", branch, "--reason", "looked at the page", *registry)
    person("registry", "show", KEY, *registry)
    entry = held(tmp_path / "fleet", KEY).entry
    K, true = entry.calibration.intrinsics, staged().intrinsics
    assert (entry.status, entry.calibration.grade) == (Status.APPROVED, Grade.CALIBRATED)
    assert (K.fx, K.fy) == pytest.approx((true.fx, true.fy), rel=2e-4)
    assert (K.cx, K.cy) == pytest.approx((true.cx, true.cy), abs=0.4)
    person("registry", "check", *registry)
    assert "nothing to do" in person("registry", "audit", flight, *registry)


def test_an_engineer_is_asked_whether_an_update_moved_k(person: Person, tmp_path: Path) -> None:
    person("registry", "init", "fleet")
    registry = ("--registry", "fleet")
    for firmware, stretch in (("01.08", 1.0), ("01.09", 1.001)):
        for model, moved in (("A1", stretch), ("B2", 1.0)):
            corners = _corners(tmp_path / f"{model}-{firmware}.json", model, firmware, moved)
            person(
                "calibrate",
                "--from",
                corners,
                *registry,
                "--approve",
                "--yes",
                "--reason",
                f"firmware {firmware}",
            )

    page = tmp_path / "update.html"
    said = person("diff", "--firmware", "01.08..01.09", *registry, "--html", page, code=1)
    assert said.index("acme/a1") < said.index("acme/b2")
    assert "drift" in said
    assert "within noise" in said
    assert "+0.1" in said or "+0.09" in said
    assert "acme/a1" in page.read_text()
    assert "drift" in person("diff", "acme/a1@firmware:01.08", "acme/a1@firmware:01.09", *registry, code=1)
    assert "within noise" in person("diff", "acme/b2@firmware:01.08", "acme/b2", *registry)


def _corners(path: Path, model: str, firmware: str, stretch: float) -> Path:
    """What a camera with some firmware saw of a board, each set of frames its own."""
    true = camera()
    K = true.intrinsics
    lens = replace(true, intrinsics=replace(K, fx=K.fx * stretch, fy=K.fy * stretch))
    seen = shoot(lens, Session(views=16), seed=sum(path.name.encode()))
    views = tuple(
        replace(view, sha256=hashlib.sha256(f"{path.name} {view.name}".encode()).hexdigest())
        for view in seen.views
    )
    named = replace(seen.camera, make="Acme", model=model)
    path.write_bytes(
        encode_corners(replace(seen, views=views, camera=named, firmware=firmware, focus="infinity"))
    )
    return path


def _refs(repository: Path) -> dict[str, str]:
    """Where every branch stands."""
    heads = repository / ".git" / "refs" / "heads"
    return {
        path.relative_to(heads).as_posix(): path.read_text() for path in heads.rglob("*") if path.is_file()
    }
