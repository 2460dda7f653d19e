"""An approved entry of the registry beside a K of the images: which is used, and what is said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.distortion import BrownConrady
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.policy import FLEET, SOURCE, Policy
from calibrary.records import replace
from calibrary.registry.entry import Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.validation import Verdict
from tests.jobs.extract.fleet import DEWARP, P4R, entry, files, gate, in_git, only, picture, plan, stated

DERIVED = 8.8 / 0.0024
CASES: list[tuple[str, float, dict[str, Any], Policy, float, str]] = [
    ("derived and agreeing", 3661.25, {}, FLEET, 3661.25, "valid"),
    ("derived and just within the tolerance", 3580.0, {}, FLEET, 3580.0, "valid"),
    ("the policy of the source document", 3661.25, {}, SOURCE, DERIVED, "rejected"),
    ("the images carry a calibration", 3661.25, {"dewarp": DEWARP}, FLEET, 3660.5, "valid"),
    ("contradicting", 3900.0, {}, FLEET, DERIVED, "unproven"),
    ("contradicting a calibration and the catalogue", 3900.0, {"dewarp": DEWARP}, FLEET, 3660.5, "valid"),
    ("the camera removed the distortion", 3661.25, {"drone_dji:DewarpFlag": "1"}, FLEET, DERIVED, "valid"),
]


def ran(folder: Path, fx: float, tags: dict[str, Any], policy: Policy = FLEET) -> JudgedCamera:
    tags = dict(tags)
    entry(folder / "registry", fx=fx)
    for number in range(2):
        picture(folder / f"flight/{number}.jpg", **P4R, **tags)
    return only(gate(folder / "flight", registry=files(folder / "registry"), policy=policy))


@pytest.mark.parametrize(
    ("_name", "fx", "tags", "policy", "used", "verdict"), CASES, ids=[case[0] for case in CASES]
)
def test_which_k_is_used(
    tmp_path: Path, _name: str, fx: float, tags: dict[str, Any], policy: Policy, used: float, verdict: str
) -> None:
    camera = ran(tmp_path, fx, tags, policy)
    found = camera.calibration or camera.camera.calibration
    assert found is not None
    assert camera.verdict.value == verdict
    assert found.intrinsics.fx == pytest.approx(used)


def test_the_measured_distortion_reaches_the_solver_and_the_text_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = ran(tmp_path, 3661.25, {})
    assert not camera.uncalibrated
    assert camera.reason is None
    assert camera.calibration is not None
    assert isinstance(camera.calibration.distortion, BrownConrady)
    report = plan(
        gate(tmp_path / "flight", registry=files(tmp_path / "registry")), tmp_path / "K.npy", "colmap"
    )
    assert b"FULL_OPENCV" in report.outputs.files[tmp_path / "colmap.sh"]
    monkeypatch.chdir(tmp_path)
    assert main(["extract", "flight", "--registry", "folder:registry", "--explain"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "calibrated" in printed
    assert (
        "it was measured (calibrated), and EXIF FocalLength ÷ catalogue pitch of the images agrees to 0.1"
        in printed
    )
    assert "uncalibrated" not in printed
    [step] = json.loads((tmp_path / "K_matrix.json").read_text())["cameras"][0]["fallback"]
    assert (step["step"], step["outcome"]) == ("registry", "taken")


def test_a_contradiction_names_both(tmp_path: Path) -> None:
    camera = ran(tmp_path, 3900.0, {})
    assert camera.verdict is Verdict.UNPROVEN
    reason = camera.reason or ""
    assert "by EXIF FocalLength ÷ catalogue pitch" in reason
    assert "cameras/dji/fc6310r/5472x3648.yaml" in reason
    assert "3900.0 px" in reason
    assert "--verify' asks the pixels" in (camera.advice or "")
    assert camera.fallback is not None
    assert "EXIF FocalLength ÷ catalogue pitch states fx" in camera.fallback.steps[-1].why


@pytest.mark.parametrize(
    ("fx", "says"),
    [
        (3661.25, None),
        (
            3900.0,
            "beside EXIF FocalLength ÷ catalogue pitch of these images "
            "cameras/dji/fc6310r/5472x3648.yaml states fx = 3900.0 px",
        ),
        (
            3745.0,
            "+2.1%, and is the better start (start: its calibration was judged: a start only; fx may be off by",
        ),
    ],
)
def test_what_is_proposed_and_contradicts_the_k_in_use_is_reported(
    tmp_path: Path, fx: float, says: str | None
) -> None:
    path = entry(tmp_path / "files", fx=fx)
    text = (
        f"{path.read_text()}quality: {{std: {{fx: 15.0, fy: 15.0}}}}\n"
        'notes: ["start: not good enough to be kept fixed", "unstable: κ² is 5"]\n'
    )
    proposed = parse_entry(text.encode(), "entry", require_digest=False)
    picture(tmp_path / "flight/0.jpg", **P4R)
    report = gate(tmp_path / "flight", registry=in_git(tmp_path / "registry", proposed))
    assert only(report).calibration is not None
    found = [text for text in report.warnings if "dji/fc6310r/5472x3648 is proposed" in text]
    assert len(found) == (says is not None)
    assert says is None or says in found[0]


P4R_IN_USE = "dji/fc6310r/5472x3648"
OTHER_SIZE, OTHER_UNIT, OTHER_MODEL = (
    "dji/fc6310r/4864x3648",
    "dji/fc6310r/sn-other/5472x3648",
    "dji/fc330/4000x3000",
)


@pytest.mark.parametrize(
    ("proposed", "heard"),
    [
        (P4R_IN_USE, True),
        (OTHER_SIZE, False),
        (OTHER_UNIT, False),
        (OTHER_MODEL, False),
    ],
    ids=["the entry that is used", "another image size", "another unit", "another model"],
)
def test_a_flight_hears_of_what_is_proposed_in_place_of_the_entries_that_it_uses(
    tmp_path: Path, proposed: str, heard: bool
) -> None:
    folder = tmp_path / "files"
    every = (
        stated(folder),
        stated(folder, image_size=(4864, 3648)),
        stated(folder, serial="other"),
        stated(folder, model="FC330", image_size=(4000, 3000)),
    )
    registry = in_git(tmp_path / "registry", *(replace(one, status=Status.APPROVED) for one in every))
    in_git(registry, *(replace(one, tolerance=0.02) for one in every if one.id == proposed))
    picture(tmp_path / "flight/0.jpg", **P4R)
    found = [text for text in gate(tmp_path / "flight", registry=registry).warnings if "proposed" in text]
    assert len(found) == heard
    assert all(proposed in text for text in found)


def test_without_a_k_what_is_proposed_is_named_and_no_start(tmp_path: Path) -> None:
    proposed = stated(tmp_path / "files", fx=3700.0, make="Example", model="One")
    picture(tmp_path / "flight/0.jpg", make="Example", model="One")
    camera = only(gate(tmp_path / "flight", registry=in_git(tmp_path / "registry", proposed)))
    assert camera.calibration is None
    assert camera.fallback is not None
    assert camera.fallback.seed is not None
    assert camera.fallback.seed.intrinsics.fx != 3700.0
    assert "example/one/5472x3648 is proposed" in camera.fallback.steps[-1].why
