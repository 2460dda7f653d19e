"""``registry export --public``: what others may have of an entry, and what is refused."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import pytest

from calibrary.calibration import Grade, Provenance, Quality, SourceFile
from calibrary.known_camera import hash_serial
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.init import init
from calibrary.registry.registry import Registry
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import printed, run
from tests.registry.entries import DIGITS, an_entry, covariance
from tests.registry.git.repositories import git

UNIT = hash_serial("DJI", "0V2LG3H0")
BOARD = Provenance(
    kind="checkerboard",
    source="/home/ada/P4R-03/corners.json",
    sources=(SourceFile(name="Ada Lovelace DJI_0001.JPG", sha256=DIGITS),),
    tool="calibrary 1.0",
    date="2026-02-03",
    operator="Ada Lovelace",
    focus="infinity",
)
PRIVATE = ("Ada", "P4R-03", "DJI_0001", UNIT, "north", "secret", "2026-05-01")


def measured() -> Entry:
    """One unit's calibration, with everything that is no one else's business."""
    return an_entry(
        focal_mm=None,
        serial=UNIT,
        label="P4R-03",
        tags=("north",),
        quality=Quality(rms_px=0.31, views=40, points=4000, covariance=covariance()),
        provenance=BOARD,
        notes=("secret",),
        reason="Ada said so",
        validity=Validity(first=date(2026, 5, 1)),
        extensions={"x-job": "secret"},
    )


def test_one_unit_s_k_becomes_an_estimate_for_its_model_with_its_evidence(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, measured())
    document = printed(
        capsys, "registry-contribution-1", "export", "fc6310r", "--public", "--out", tmp_path / "out"
    )
    assert document["path"] == "proposals/dji/fc6310r/5472x3648.yaml"
    assert document["grade"] == "derived"
    assert document["left_out"] == [
        "serial", "operator", "file names", "notes", "reason", "validity", "label", "tags", "x-job"
    ]  # fmt: skip
    data = (tmp_path / "out" / document["path"]).read_bytes()
    assert not [word for word in PRIVATE if word.encode() in data]
    entry = parse_entry(data, "it")
    own = measured().calibration
    assert (entry.calibration.intrinsics, entry.calibration.distortion) == (own.intrinsics, own.distortion)
    assert (entry.status, entry.calibration.grade, entry.tolerance) == (Status.DRAFT, Grade.DERIVED, 0.03)
    assert entry.calibration.quality is None
    evidence = entry.extensions["x-evidence"]
    assert own.quality is not None
    assert own.quality.covariance is not None
    assert (evidence["grade"], evidence["units"], evidence["rms_px"]) == ("calibrated", 1, 0.31)
    assert evidence["std"] == pytest.approx(own.quality.covariance.std)
    made = entry.calibration.provenance
    assert made.sources == (SourceFile(name="frame-1.jpg", sha256=DIGITS),)
    assert (made.tool, made.date, made.focus, made.operator) == (
        "calibrary 1.0",
        "2026-02-03",
        "infinity",
        None,
    )


def test_the_public_registry_takes_it(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, measured())
    public = Registry.open(init(tmp_path / "public").place).repo.path
    code, out, _ = run(capsys, "export", "fc6310r", "--public", "--out", public)
    assert code == 0
    assert "look at the file before you send it" in " ".join(out.split())
    git(public, "add", "proposals")
    git(public, "commit", "--quiet", "-m", "Propose the P4R")
    assert run(capsys, "check", "--registry", public)[0] == 0
    pending = Registry.open(public).snapshot().pending("fc6310r")
    assert pending.entry.calibration.intrinsics == measured().calibration.intrinsics


def test_what_is_of_the_model_already_keeps_its_grade(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(grade=Grade.DESIGN, quality=Quality(rms_px=0.5)))
    document = printed(
        capsys, "registry-contribution-1", "export", "fc6310r", "--public", "--out", tmp_path / "out"
    )
    entry = parse_entry((tmp_path / "out" / document["path"]).read_bytes(), "it")
    assert (entry.calibration.grade, entry.calibration.quality) == (Grade.DESIGN, Quality(rms_px=0.5))
    assert entry.calibration.provenance.source == f"sha256-{DIGITS[:12]}.xml"
    assert entry.extensions == {}


@pytest.mark.parametrize(
    ("entries", "expected"),
    [
        ([an_entry(status=Status.DRAFT)], "only an approved or held entry"),
        ([an_entry(status=Status.RETIRED)], "is retired"),
        ([an_entry(override="I know better")], "others cannot rely on that: I know better"),
        (
            [an_entry(provenance=Provenance(kind="manual", operator="Ada"))],
            "no source that others could check",
        ),
        ([an_entry(), an_entry(serial=UNIT, fx=3800.0)], r"another has an fx \+3.8% off"),
    ],
)
def test_what_others_cannot_rely_on_is_refused_in_one_line(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], entries: list[Entry], expected: str
) -> None:
    put(fleet, *entries)
    code, _, said = run(capsys, "export", "dji/fc6310r/5472x3648+f8.8", "--public", "--out", tmp_path / "out")
    assert (code, said.count("\n")) == (4, 1)
    assert expected.replace("\\", "") in said
    assert not (tmp_path / "out").exists()
