"""``calibrary calibrate combine``: from files and entries to one entry, or to why not."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from calibrary import parsers
from calibrary.calibration import CameraKey
from calibrary.cli.main import main
from calibrary.records import replace
from tests.jobs.combine.made import OTHER, made
from tests.registry.git.repositories import seclude


@pytest.fixture(autouse=True)
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seclude(monkeypatch, tmp_path)
    monkeypatch.chdir(tmp_path)
    for at in range(3):
        # As calibrate --json prints it, and as Calibration.to_dict does.
        document = made("", at, date=f"2025-0{at + 3}-04").calibration.to_dict()
        Path(f"{at}.json").write_text(json.dumps({"calibration": document} if at else document))
    Path("odd.json").write_text(json.dumps(made("", 7, truth=OTHER).calibration.to_dict()))


def test_files_that_agree_become_an_entry(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["registry", "init", "fleet", "--yes"]) == 0
    capsys.readouterr()
    keep = ["--registry", "fleet", "--yes", "--approve", "--reason", "three seasons"]
    out = ["--out", "camera.xml", "--to", "agisoft_xml"]
    assert main(["calibrate", "combine", "0.json", "1.json", "2.json", *keep, *out]) == 0
    said = capsys.readouterr().out
    assert "3 calibrations, of 2025-03-04 to 2025-05-04, agree" in " ".join(said.split())
    assert said.splitlines()[-1].startswith("FIXED  Example Flight One 1500×1000: 3 calibrations as one")
    entry = next(Path("fleet/cameras").rglob("*.yaml")).read_text(encoding="utf-8")
    assert 'kind: "combination"' in entry
    assert 'name: "1.json"' in entry
    assert 'date: "2025-05-04"' in entry
    assert '"verdict": "pass"' in entry
    assert "combined_from" in entry
    # What was combined can be read again with its covariance, from the file and from the registry.
    [file] = parsers.read("camera.xml")
    assert file.quality is not None
    assert file.quality.covariance is not None
    assert main(["calibrate", "combine", "flight_one", "--registry", "fleet", "--json", "--yes"]) == 0
    assert json.loads(capsys.readouterr().out)["sources"][0]["label"].startswith(
        "example/flight_one/1500x1000@"
    )


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        (
            ("0.json", "1.json", "2.json"),
            ("3 calibrations of Example Flight One", "pass", "by date", "2025-04-04"),
        ),
        (("0.json", "1.json", "odd.json"), ("not combined", "refused", "inconsistent", "odd.json")),
    ],
)
def test_the_page_shows_each_against_the_others(
    files: tuple[str, ...], expected: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    main(["calibrate", "combine", *files, "--html", "combined.html"])
    assert "wrote combined.html" in capsys.readouterr().out
    page = Path("combined.html").read_text(encoding="utf-8")
    for word in (*expected, *files, "<svg"):
        assert word in page


def test_files_that_disagree_become_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["registry", "init", "fleet", "--yes"]) == 0
    capsys.readouterr()
    flags = ["--registry", "fleet", "--yes", "--out", "camera.xml", "--to", "agisoft_xml", "--json"]
    assert main(["calibrate", "combine", "0.json", "1.json", "2.json", "odd.json", *flags]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["verdict"] == "refuse"
    assert document["calibration"] is None
    assert "odd.json disagrees with 0.json, 1.json, 2.json by" in document["findings"][0]["message"]
    off = {one["label"]: one["off_px"] for one in document["sources"]}
    assert max(off, key=lambda label: off[label]) == "odd.json"
    assert not Path("camera.xml").exists()
    assert not [*Path("fleet/cameras").rglob("*.yaml"), *Path("fleet/proposals").rglob("*.yaml")]
    assert (
        main(["calibrate", "combine", "0.json", "odd.json", "--out", "camera.xml", "--to", "agisoft_xml"])
        == 1
    )
    assert "not written: camera.xml: it is refused" in capsys.readouterr().out


def test_metashapes_own_sigma_is_provisional_at_the_most(capsys: pytest.CaptureFixture[str]) -> None:
    for at in range(2):
        plain = replace(made("", at).calibration, camera=CameraKey(image_size=(1500, 1000)))
        parsers.write([plain], Path(f"{at}.xml"), format="agisoft_xml")
    camera = ["--make", "Example", "--model", "Flight One"]
    assert main(["registry", "init", "fleet", "--yes"]) == 0
    keep = ["--registry", "fleet", "--yes", "--approve", "--reason", "for now"]
    assert main(["calibrate", "combine", "0.xml", "1.xml", *camera, *keep]) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "formal-sigma: σ of 0.xml, 1.xml is that of the program that made it" in said
    assert "START Example Flight One" in said
    assert "it is used as a start: no solver keeps it fixed" in said
    assert [*Path("fleet/cameras").rglob("*.yaml")]


def test_no_folder_gets_into_an_entry(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in ("a", "b"):
        (tmp_path / "private" / folder).mkdir(parents=True)
    Path("0.json").rename("private/a/k.json")
    Path("1.json").rename("private/b/k.json")
    files = [str(tmp_path / "private/a/k.json"), str(tmp_path / "private/b/k.json"), str(tmp_path / "2.json")]
    main(["calibrate", "combine", *files, "--json"])
    printed = capsys.readouterr().out
    assert [one["label"] for one in json.loads(printed)["sources"]] == ["a/k.json", "b/k.json", "2.json"]
    assert "private" not in printed


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["none.json"], "no such file"),
        (["0.json", "--to", "agisoft_xml"], "--out"),
        (["0.json", "--approve"], "--registry"),
    ],
)
def test_what_makes_no_sense_is_said(
    words: list[str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code: object = None
    try:
        code = main(["calibrate", "combine", *words])
    except SystemExit as stop:
        code = stop.code
    assert code in {2, 3}
    assert problem in capsys.readouterr().err


PROVISIONAL = "provisional: not good enough to be approved"


@pytest.mark.parametrize(
    ("notes", "files"),
    [
        ((PROVISIONAL, "focal-length-or-height: flat"), ("0.json", "1.json", "short.json")),
        # What more calibrations cure is not cured by none.
        ((PROVISIONAL, "few-images: 12"), ("short.json",)),
    ],
)
def test_what_was_provisional_stays_a_start_when_it_is_combined(
    notes: tuple[str, ...], files: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("short.json").write_text(json.dumps(made("", 5, notes=notes).calibration.to_dict()))
    assert main(["registry", "init", "fleet", "--yes"]) == 0
    assert main(["calibrate", "combine", *files, "--registry", "fleet", "--yes"]) == 1
    capsys.readouterr()
    key = ["example/flight_one/1500x1000", "--registry", "fleet"]
    assert main(["registry", "show", *key]) == 0
    assert "start: its calibration was judged: a start only" in " ".join(capsys.readouterr().out.split())
    assert main(["registry", "show", *key, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["use"] == "start"
    # Also where somebody removed its notes, which an approval does not cover.
    [file] = Path("fleet/proposals").rglob("*.yaml")
    kept = file.read_text(encoding="utf-8")
    Path("bare.yaml").write_text(re.sub(r"(?m)^notes:\n(  .*\n)+", "", kept), encoding="utf-8")
    assert "not good enough" not in Path("bare.yaml").read_text(encoding="utf-8")
    assert main(["calibrate", "combine", "bare.yaml", "2.json", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert (document["verdict"], document["findings"][0]["rule"]) == ("provisional", "provisional-source")
