"""The same question gets the same answer in every command: is this K right for these images?"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from tests.jobs.extract.fleet import DEWARP, P4R, entry, picture
from tests.registry.git.repositories import seclude


def answered(capsys: pytest.CaptureFixture[str], *command: str | Path) -> Any:
    main([*map(str, command), "--json"])
    return json.loads(capsys.readouterr().out)


def unit(folder: Path, fx: float, names: tuple[str, ...] = ("IMG_1.jpg", "IMG_2.jpg")) -> Path:
    """Images of one unit that state its own calibration."""
    dewarp = DEWARP.replace("3660.5,", f"{fx},", 1)
    for name in names:
        picture(folder / name, (5472, 3648), **P4R, focal_35mm=24, body_serial="AB12", dewarp=dewarp)
    return folder


def test_a_units_k_that_moved_is_said_by_extract_audit_and_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    seclude(monkeypatch, tmp_path)
    assert main(["registry", "init", "fleet"]) == 0
    before = unit(tmp_path / "before", 3660.5, ("IMG_1.jpg",)) / "IMG_1.jpg"
    approve = ("--approve", "--reason", "measured", "--yes", "--registry", "fleet")
    assert main(["registry", "add", str(before), *approve]) == 0
    capsys.readouterr()
    for fx, moved in ((3660.5, False), (3667.1, True)):  # 0.18 %: 3.4 px rms
        flight = unit(tmp_path / f"flight{fx}", fx)
        [camera] = answered(capsys, "extract", flight, "--registry", "fleet", "--dry-run")["cameras"]
        assert (camera["verdict"], "another K" in (camera["why"] or "")) == (
            ("unproven", True) if moved else ("valid", False)
        )
        [checked] = answered(capsys, "check", flight, before, "--registry", "fleet")["files"]
        assert checked["verdict"] == ("off" if moved else "right")
        audit = answered(capsys, "registry", "audit", flight, "--registry", "fleet")
        assert ("K drifted" in [one["rule"] for one in audit["findings"]]) == moved


def test_two_measurements_that_are_far_apart_are_as_far_apart_in_every_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    seclude(monkeypatch, tmp_path)
    assert main(["registry", "init", "fleet"]) == 0
    before = unit(tmp_path / "before", 3660.5, ("IMG_1.jpg",)) / "IMG_1.jpg"
    approve = ("--approve", "--reason", "measured", "--yes", "--registry", "fleet")
    assert main(["registry", "add", str(before), *approve]) == 0
    later = tmp_path / "flight/IMG_1.jpg"
    dewarp = DEWARP.replace("3660.5,3655.25", "4000.0,3994.5", 1)
    picture(later, (5472, 3648), **P4R, focal_35mm=24, body_serial="AB12", dewarp=dewarp)
    capsys.readouterr()
    far, at = "182 px rms and 306 px at most over the frame", ("--registry", "fleet")
    [camera] = answered(capsys, "extract", later.parent, *at, "--dry-run")["cameras"]
    assert (camera["verdict"], far in camera["why"]) == ("unproven", True)
    [checked] = answered(capsys, "check", later.parent, before, *at)["files"]
    assert (checked["verdict"], round(checked["rms_px"]), round(checked["max_px"])) == ("off", 182, 306)
    audit = answered(capsys, "registry", "audit", later.parent, *at)["findings"]
    assert [far in one["message"] for one in audit if one["severity"] == "error"] == [True]
    added = {one["rule"]: one for one in answered(capsys, "registry", "add", later, *at)["findings"]}
    found = added["against-last-approved"]
    assert (found["severity"], far in found["message"], "material-change" in added) == ("error", True, False)
    for pair in ((before, later), (later, before)):
        assert far in answered(capsys, "diff", *pair)["reasons"][1]


def test_the_right_entry_of_an_unknown_camera_makes_no_tag_believed_that_is_not_believed_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A resized image keeps its FocalPlaneResolution, which then is of a sensor 4.5 mm wide."""
    monkeypatch.chdir(tmp_path)
    canon: dict[str, Any] = {"make": "Canon", "model": "Canon EOS 600D", "focal_mm": (24, 1)}
    for number in (1, 2):
        plane: dict[str, Any] = {"focal_plane_resolution": ((5184000, 894), (3456000, 597))}
        picture(tmp_path / f"flight/{number}.jpg", (1200, 800), **canon, **plane)
    alone = answered(capsys, "extract", "flight", "--dry-run")["cameras"][0]
    entry(
        tmp_path / "registry",
        fx=1322.0,
        make="Canon",
        model="Canon EOS 600D",
        image_size=(1200, 800),
    )
    [camera] = answered(capsys, "extract", "flight", "--registry", "folder:registry", "--dry-run")["cameras"]
    assert alone["verdict"] == "unproven"
    assert camera["verdict"] == "valid", camera["why"]
    assert camera["calibration"]["intrinsics"]["fx"] == 1322.0
