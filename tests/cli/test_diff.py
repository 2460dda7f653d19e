"""``calibrary diff``: two calibrations of any kind, or a fleet then and now, from the command line."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrary import parsers
from calibrary.cli.main import main
from calibrary.jobs.fleet import open_registry
from calibrary.records import replace
from calibrary.registry.entry import Status
from calibrary.registry.init import init
from calibrary.registry.registry import Registry
from calibrary.schemas import require
from tests.cli.registry.direct import put_bytes
from tests.jobs.diff.cameras import camera, changed
from tests.jobs.site.fleet import fleet, later, save
from tests.registry.entries import an_entry
from tests.registry.git.repositories import seclude

FC6310R = "dji/fc6310r"
ALARM, USAGE, INPUT, REGISTRY = 1, 2, 3, 4


@pytest.fixture(scope="module")
def registry(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A fleet with a past, which every command takes for the one that is meant."""
    folder = tmp_path_factory.mktemp("diff")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        fleet(folder / "fleet")
        patch.setenv("CALIBRARY_REGISTRY", str(folder / "fleet"))
        yield folder / "fleet"


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """One camera in three formats, and twice moved."""
    one = camera()
    parsers.write([one], tmp_path / "one.xml", "agisoft_xml")
    parsers.write([one], tmp_path / "same.yml", "opencv_storage")
    drifted = changed(one, fx=3678.9 * 1.01, fy=3678.1 * 1.01)
    parsers.write([drifted], tmp_path / "drifted.xml", "agisoft_xml")
    parsers.write([changed(one, cx=2732.0, cy=1847.3)], tmp_path / "half.yml", "opencv_storage")
    # As OpenCV's programs write it, counted from the first pixel's centre.
    np.save(tmp_path / "K.npy", one.intrinsics.matrix - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    return tmp_path


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    code = main(["diff", *map(str, arguments)])
    said = capsys.readouterr()
    return code, said.out, said.err


def printed(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, Any]:
    """The exit code and the document, once its schema has let it through."""
    code, out, _ = run(capsys, *arguments, "--json")
    document = json.loads(out)
    require(document, document["schema"].removeprefix("calibrary/"))
    return code, document


def seen(page: Path) -> str:
    """What a reader of a page sees."""
    return html.unescape(
        re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page.read_text().partition("<body>")[2]))
    )


def test_one_camera_in_two_formats_is_identical(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, files / "one.xml", files / "same.yml")
    assert code == 0
    assert "identical" in out


def test_the_document_keeps_to_its_schema_and_says_what_was_compared(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, document = printed(capsys, files / "one.xml", files / "drifted.xml", "--altitude-m", "50")
    assert (code, document["verdict"], document["alarm"]) == (ALARM, "drift", True)
    numbers = document["numbers"]
    assert numbers["focal_change"] == pytest.approx(0.01)
    assert numbers["ground"]["height_cm"] == pytest.approx(50.0, rel=1e-3)
    [fx] = [row for row in numbers["parameters"] if row["name"] == "fx"]
    assert fx["delta"] == pytest.approx(36.789)
    assert document["a"]["calibration"]["intrinsics"]["fx"] == pytest.approx(3678.9)


def test_the_last_line_says_which_to_use(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, files / "one.xml", files / "drifted.xml")
    assert code == ALARM
    last = out.rstrip().splitlines()[-1]
    assert last.startswith(
        "drift, needs attention. Keep using A until you know why only fx and fy differ: changed"
    )
    assert "e+" not in out


def test_a_k_in_millimetres_is_an_input_error(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(files / "mm.npy", np.diag([8.87, 8.87, 1.0]) + np.array([[0, 0, 6.6], [0, 0, 4.4], [0, 0, 0]]))
    code, out, err = run(capsys, files / "one.xml", files / "mm.npy")
    assert (code, out) == (INPUT, "")
    assert "millimetres" in err or "pixels" in err


def test_a_file_that_lists_one_camera_several_times_needs_no_choice(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = camera()
    names = [
        replace(one, camera=replace(one.camera, focal_mm=None, model=name)) for name in ("FC6310R", "FC6310S")
    ]
    parsers.write(names, files / "cameras.json", "opensfm")
    code, document = printed(capsys, files / "one.xml", files / "cameras.json")
    assert (code, document["verdict"]) == (0, "identical")
    parsers.write([names[0], changed(names[1], fx=3700.0)], files / "cameras.json", "opensfm")
    code, _, err = run(capsys, files / "one.xml", files / "cameras.json")
    assert (code, "choose one with --camera" in err) == (INPUT, True)
    both = (files / "cameras.json", files / "cameras.json")
    code, document = printed(capsys, *both, "--camera", "camera 1")
    assert (code, document["verdict"]) == (0, "identical")
    code, document = printed(capsys, *both, "--camera", "camera 1,camera 2")
    assert (code, document["alarm"]) == (ALARM, True)


def test_a_change_of_kind_is_named(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, document = printed(capsys, files / "same.yml", files / "half.yml")
    assert (code, document["verdict"]) == (ALARM, "structural")
    assert [one["kind"] for one in document["structural"]] == ["half-pixel convention"]


def test_a_matrix_beside_a_file_takes_its_size_from_it_and_its_k_alone_is_compared(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, document = printed(capsys, files / "K.npy", files / "same.yml")
    assert document["numbers"]["image_size"] == [5472, 3648]
    assert document["numbers"]["distortion_compared"] is False
    assert {row["name"]: row["delta"] for row in document["numbers"]["parameters"]}["cx"] == pytest.approx(0)
    assert (code, document["verdict"]) == (0, "negligible")


def test_an_entry_is_compared_with_what_it_was(registry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = Registry.open(registry).history("dji/fc6310r/5472x3648+f8.8")[-1].revision.commit
    code, document = printed(capsys, f"{FC6310R}@{first}", FC6310R)
    assert (code, document["verdict"]) == (ALARM, "drift")
    assert document["numbers"]["significance"]["spread_a"].startswith("its own covariance")


def test_an_entry_is_compared_by_firmware(registry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, document = printed(capsys, f"{FC6310R}@firmware:01.08", f"{FC6310R}@firmware:01.09")
    assert (code, document["verdict"]) == (ALARM, "drift")
    assert str(registry) not in json.dumps(document)


def test_a_policy_may_be_more_patient(
    files: Path, registry: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    patient = files / "patient.yaml"
    patient.write_text(
        'schema: "calibrary/policy-1"\nname: "patient"\nbase: "fleet"\n'
        "drift_focal: 0.05\ndrift_rms_px: 50\ndrift_max_px: 50\n"
    )
    old, new = f"{FC6310R}@firmware:01.08", f"{FC6310R}@firmware:01.09"
    code, document = printed(capsys, old, new, "--policy", str(patient), "--registry", str(registry))
    assert (code, document["verdict"]) == (0, "negligible")


def test_the_fleet_since_a_commit_stands_worst_first(
    registry: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    began = Registry.open(registry).history()[-2].revision.commit
    code, document = printed(capsys, "--since", began)
    assert code == ALARM
    verdicts = [change["verdict"] for change in document["changes"]]
    assert verdicts[:2] == ["structural", "drift"]
    assert verdicts.count(None) == 5
    assert document["changes"][-1]["reasons"] == ["new"]


def test_the_fleet_since_now_has_not_changed(registry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    newest = Registry.open(registry).commit()
    code, document = printed(capsys, "--since", newest)
    assert (code, document["changes"], document["unmatched"]) == (0, [], None)
    code, out, _ = run(capsys, "--since", newest)
    assert (code, out.strip()) == (0, "no entry differs")


def test_the_fleet_from_one_firmware_to_another(registry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, document = printed(capsys, "--firmware", "01.08..01.09", "--registry", registry)
    assert code == ALARM
    [change] = document["changes"]
    assert (change["id"], change["verdict"]) == ("dji/fc6310r/5472x3648+f8.8", "drift")


def past(folder: Path, *made_with: str, proposed: str | None = None) -> Registry:
    """A camera's approved calibrations, each 0.1 % off the last and by a firmware, and one that waits."""
    made = Registry.open(init(folder).place)
    for number, firmware in enumerate(made_with):
        save(made, [later(an_entry(), fx=4.0 * number, firmware=firmware)], f"Calibrate with {firmware}")
    if proposed is not None:
        moved = replace(later(an_entry(), fx=-4.0, firmware=proposed), status=Status.DRAFT)
        open_registry(folder).propose_entries([moved]).write()
    return made


@pytest.mark.parametrize("asked", ["v01.08..v01.09", "1.8..1.9", "01.08.0000..01.09.1691"])
def test_the_beginning_of_a_version_finds_the_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], asked: str
) -> None:
    folder = past(tmp_path / "fleet", "v01.08.0000", "v01.09.1691").repo.path
    code, document = printed(capsys, "--firmware", asked, "--registry", folder)
    assert (code, [change["verdict"] for change in document["changes"]]) == (ALARM, ["drift"])
    assert (
        printed(capsys, f"{FC6310R}@firmware:01.09", FC6310R, "--registry", folder)[1]["verdict"]
        == "identical"
    )


def test_a_range_of_firmware_of_which_there_is_nothing_needs_attention(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = past(tmp_path / "fleet", "v01.08.0000", "v01.09.1691").repo.path
    code, out, _ = run(capsys, "--firmware", "03..04", "--registry", folder)
    there = "there is v01.08.0000, v01.09.1691"
    assert (code, out.strip()) == (ALARM, f"no entry was made with firmware 03 or 04: {there}")
    code, document = printed(capsys, "--firmware", "01.09..01.10", "--registry", folder)
    [change] = document["changes"]
    assert (code, change["verdict"]) == (ALARM, None)
    assert change["reasons"] == ["it has no calibration of firmware 01.10: there is v01.09.1691, v01.08.0000"]
    code, _, err = run(capsys, f"{FC6310R}@firmware:02", FC6310R, "--registry", folder)
    assert code == REGISTRY
    assert "there is v01.09.1691, v01.08.0000" in err


def test_a_proposal_is_compared_with_the_entry_that_it_would_replace(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "fleet"
    began = past(folder, "v01.09.1691", proposed="v01.10.0002").history()[1].revision.commit
    for asked in (("--since", began), ("--firmware", "01.09..01.10")):
        code, document = printed(capsys, *asked, "--registry", folder)
        [change] = document["changes"]
        assert (code, change["verdict"]) == (ALARM, "drift")
        assert change["id"] == "dji/fc6310r/5472x3648+f8.8@proposed"


def test_an_entry_that_cannot_be_read_is_not_compared_and_needs_attention(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = past(tmp_path / "fleet", "v01.09.1691")
    began, [path] = made.commit(), [*made.snapshot().paths]
    put_bytes(made.repo.path, {path: b"nonsense"})
    code, document = printed(capsys, "--since", began, "--registry", made.repo.path)
    assert (code, document["changes"][0]["verdict"], document["changes"][0]["alarm"]) == (ALARM, None, True)


def test_a_page_shows_what_the_terminal_says(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = files / "diff.html"
    code, out, _ = run(capsys, files / "one.xml", files / "drifted.xml", "--html", page)
    assert code == ALARM
    printed = seen(page)
    assert "drift" in out
    for text in ("drift", "+1.0%", "3715.69", "one.xml", "drifted.xml", "On the ground", "σ of A"):
        assert text in printed
    assert page.read_text().count('<svg class="plot') == 1


def test_a_page_of_the_fleet_has_every_comparison(
    registry: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, began = tmp_path / "fleet.html", Registry.open(registry).history()[-2].revision.commit
    code, _, _ = run(capsys, "--since", began, "--html", page)
    assert code == ALARM
    text = page.read_text()
    targets = re.findall(r'<a href="#(entry-\d+)"', text)
    assert len(targets) == len(set(targets)) == 7
    assert set(targets) <= set(re.findall(r'<h2 id="([^"]+)"', text))
    assert "<script" not in text
    assert "<script>document.title='owned'</script>" not in text


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["one.xml"],
        ["one.xml", "same.yml", "half.yml"],
        ["one.xml", "same.yml", "--since", "v1"],
        ["--since", "v1", "--firmware", "1..2"],
        ["one.xml", "same.yml", "--altitude-m", "0"],
        ["one.xml", "same.yml", "--altitude-m", "nan"],
    ],
    ids=" ".join,
)
def test_a_line_that_makes_no_sense_is_a_matter_of_usage(
    files: Path, arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(files)
    with pytest.raises(SystemExit) as ended:
        main(["diff", *arguments])
    assert ended.value.code == USAGE
    said = capsys.readouterr().err
    assert any(
        words in said for words in ("expected", "not allowed with", "unrecognized arguments: half.yml")
    )


def test_a_range_of_firmware_needs_both_ends(registry: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diff", "--firmware", "01.08", "--registry", str(registry)]) == USAGE
    assert "OLD..NEW" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "printed"),
    [
        (("one.xml", "torn.xml"), INPUT, "torn.xml"),
        (("one.xml", "same.yml", "--policy", "nowhere.yaml"), INPUT, "nowhere.yaml"),
        (("one.xml", "same.yml", "--html", "page.pdf"), INPUT, ".html"),
        (("one.xml", "same.yml", "--html", "/dev/null/page.html"), INPUT, "is a file; expected a folder"),
        (("one.xml", "nobody/knows-it"), REGISTRY, "knows-it"),
        (("one.xml", "dji/fc6310r@1999-01-01"), REGISTRY, "1999"),
        (("--since", "no-such-tag"), REGISTRY, "no-such-tag"),
        (("--firmware", "soon..later"), INPUT, "soon"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else None,
)
def test_what_cannot_be_read_is_named(
    registry: Path,
    files: Path,
    arguments: tuple[str, ...],
    code: int,
    printed: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (files / "torn.xml").write_text("<calibration><projection>frame")
    monkeypatch.chdir(files)
    found, out, err = run(capsys, *arguments)
    assert (found, out) == (code, "")
    assert printed in err
    assert registry.is_dir()


def test_nothing_is_written_where_a_page_cannot_be(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(files.iterdir())
    code, _, _ = run(capsys, files / "one.xml", files / "one.xml", "--html", files)
    assert code == INPUT
    assert sorted(files.iterdir()) == before
