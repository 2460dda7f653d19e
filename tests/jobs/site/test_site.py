"""A site: complete, the same in every run, put in its place whole, and never over what somebody else made."""

from __future__ import annotations

import html
import re
import shutil
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from calibrary import parsers
from calibrary.cli.main import main
from calibrary.errors import InputError
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.site import building
from calibrary.jobs.site.building import Site, build
from calibrary.jobs.site.camera_page import STRONG
from calibrary.jobs.site.folder import MARKER, Place, way
from calibrary.registry.entry import Status
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import FileChange, write
from calibrary.registry.proposals import message_of
from calibrary.registry.registry import Registry
from tests.jobs.site.fleet import DRIFTED, HOSTILE, P4R, SETTLED

P4R_PAGE = "cameras/dji/fc6310r/5472x3648+f8.8.html"
CAMERAS = 8


def text(page: Path) -> str:
    """What a reader sees."""
    body = page.read_text(encoding="utf-8").partition("<body>")[2].partition("<script>")[0]
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body)))


def bytes_of(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file()}


def targets(page: Path) -> list[str]:
    return [
        html.unescape(found) for found in re.findall(r'<a href="([^"]*)"', page.read_text(encoding="utf-8"))
    ]


def test_every_link_is_relative_and_leads_somewhere(site: Site) -> None:
    followed = 0
    for page in site.root.rglob("*.html"):
        anchors = set(re.findall(r'id="([^"]+)"', page.read_text(encoding="utf-8")))
        for target in targets(page):
            parts = urlsplit(target)
            assert (parts.scheme, parts.netloc, target[:1] == "/") == ("", "", False)
            if parts.path:
                assert (page.parent / unquote(parts.path)).resolve().is_relative_to(site.root.resolve())
                assert (page.parent / unquote(parts.path)).is_file()
                followed += 1
            else:
                assert parts.fragment in anchors
    assert followed > 100


def test_the_list_leads_to_every_camera(site: Site) -> None:
    listed = [target for target in targets(site.root / "index.html") if target.startswith("cameras/")]
    assert len(listed) == len(set(listed)) == CAMERAS
    assert "8 cameras, 8 of them in use" in text(site.root / "index.html")


def test_a_camera_is_shown_with_its_numbers_and_where_they_are_from(site: Site) -> None:
    told = text(site.root / P4R_PAGE)
    for part in (
        "3665.60 ± 0.30 px",
        "brown model",
        "−0.262",
        "reprojection error (RMS) 0.28 px",
        "κ² 1.4",
        "lab-2.xml",
    ):
        assert part in told
    assert "fx moves with fy: correlation +0.97" in told
    shares = re.findall(r": correlation ([+−]\d\.\d\d)", told)
    assert min(abs(float(share.replace("−", "-"))) for share in shares) >= STRONG
    assert "01.09" in told


def test_a_camera_of_which_little_is_known_says_so(site: Site) -> None:
    told = text(site.root / "cameras/dji/fc330/4000x3000+f3.61.html")
    assert "The distortion is unknown (which is not the same as no distortion)." in told
    assert "Its source states no uncertainty." in told
    assert "checked in the air" in told


def test_the_history_is_told_and_drawn_with_its_firmware(site: Site) -> None:
    page = (site.root / P4R_PAGE).read_text(encoding="utf-8")
    [alt] = re.findall(r"<desc[^>]*>(Timeline[^<]*)</desc>", page)
    assert "3 revisions" in alt
    assert "fx 3661.25 to 3665.60 px, 3665.60 now" in alt
    assert "firmware 01.09 before" in alt
    told = text(site.root / P4R_PAGE)
    assert "+4.10" in told
    assert "firmware 01.09 came out" in told


def test_whoever_put_it_to_use_is_named_with_day_and_commit(site: Site) -> None:
    assert re.search(r"approved\s*\d{4}-\d\d-\d\d by [\w ]+, commit [0-9a-f]{12}", text(site.root / P4R_PAGE))


def test_every_change_of_the_calibration_has_its_comparison_one_click_away(site: Site) -> None:
    changes = [target for target in targets(site.root / P4R_PAGE) if "/changes/" in target]
    verdicts = []
    for target in changes:
        page = (site.root / P4R_PAGE).parent / unquote(target)
        verdicts.append(re.sub(r"<[^>]+>", "", page.read_text().partition("<h1>")[2].partition("</h1>")[0]))
    assert ["negligible" in verdicts[0], "drift" in verdicts[1]] == [True, True]
    found = compare(P4R.calibration, DRIFTED.calibration)
    assert found.numbers is not None
    page = (site.root / P4R_PAGE).parent / unquote(changes[1])
    assert f"{found.numbers.projection.rms_px:.3g} px rms" in text(page)
    assert compare(DRIFTED.calibration, SETTLED.calibration).verdict.value in verdicts[0]


def test_an_approval_is_told_without_a_comparison(site: Site) -> None:
    page = site.root / "cameras/dji/fc330/4000x3000+f3.61.html"
    assert re.search(r"approve\s.*Approve the FC330", text(page))
    assert not [target for target in targets(page) if "/changes/" in target]


def test_every_download_reads_back_as_the_entry(site: Site) -> None:
    folder = site.root / "files/dji/fc6310r/5472x3648+f8.8"
    names = {path.name for path in folder.iterdir()}
    assert len(names) > 12
    for record in parsers.formats():
        path = next((folder / name for name in names if f"-{record.name}." in name), None)
        if path is None:
            continue
        size = SETTLED.calibration.intrinsics.image_size if record.needs_image_size else None
        [copy] = parsers.read(path, format=record.name, image_size=size)
        assert copy.intrinsics.fx == pytest.approx(SETTLED.calibration.intrinsics.fx, rel=1e-6)


def test_the_entrys_own_file_is_there_byte_for_byte(site: Site, registry: Path) -> None:
    held = Registry.open(registry).get("dji/fc6310r")
    path = site.root / "files/dji/fc6310r/5472x3648+f8.8/5472x3648+f8.8-entry.yaml"
    assert path.read_bytes() == Registry.open(registry).repo.blob(held.oid or "")


def test_what_no_file_can_hold_is_said(site: Site) -> None:
    told = text(site.root / "cameras/example/one_fish/1000x1000+f1.8.html")
    assert "has no kannala-brandt model" in told
    assert "calibrary convert" in told


def test_hostile_names_are_text(site: Site) -> None:
    pages = [page for page in site.root.rglob("*.html") if page.name != "index.html"]
    told = " ".join(map(text, pages))
    for page in site.root.rglob("*.html"):
        raw = page.read_text(encoding="utf-8")
        assert "<script>document" not in raw
        assert "<img src=x" not in raw
        assert "\u202e" not in raw
    for name in HOSTILE:
        assert name.replace("\u202e", "\\u202e").replace("\u2066", "\\u2066") in told


def test_the_same_commit_gives_the_same_bytes_on_any_number_of_processes(
    site: Site, registry: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(building, "WORTH_A_POOL", 1)
    told: list[tuple[int, int]] = []
    again = build(
        registry, tmp_path / "again", workers=2, progress=lambda done, total: told.append((done, total))
    )
    assert bytes_of(again.root) == bytes_of(site.root)
    assert told[-1] == (CAMERAS, CAMERAS)


def test_an_earlier_site_is_replaced_whole(site: Site, registry: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(site.root, out)
    (out / "cameras" / "left-over.html").write_text("old")
    build(registry, out, workers=1)
    assert bytes_of(out) == bytes_of(site.root)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("name", ["thesis.tex", ".git"])
def test_what_somebody_else_made_is_left_alone(registry: Path, tmp_path: Path, name: str) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine")
    with pytest.raises(InputError, match="is not a site made by calibrary"):
        build(registry, out)
    assert [path.name for path in out.iterdir()] == [name]


def test_what_somebody_put_beside_the_site_is_not_removed(site: Site, registry: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(site.root, out)
    (out / "CNAME").write_text("cameras.example.com")
    with pytest.raises(InputError, match="contains CNAME beside the site"):
        build(registry, out)
    assert (out / "CNAME").read_text() == "cameras.example.com"


@pytest.mark.parametrize("out", ["file", "file/out"])
def test_a_place_that_is_none_is_refused(registry: Path, tmp_path: Path, out: str) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="folder"):
        build(registry, tmp_path / out)


def test_a_build_that_fails_leaves_the_old_site_and_nothing_else(
    site: Site, registry: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    shutil.copytree(site.root, out)

    def fail(*_: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(building, "listing", fail)
    with pytest.raises(KeyboardInterrupt):
        build(registry, out, workers=1)
    assert bytes_of(out) == bytes_of(site.root)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_entry_that_is_none_is_told_and_does_not_end_the_others(
    registry: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = shutil.copytree(registry, tmp_path / "fleet")
    repo = Repository.open(copy)
    path = f"events/cameras/dji/broken/1x1/2026-11-01-retire-ada-{'0' * 32}.json"
    write(repo, [FileChange(path=path, data=b"<script>", base=None)], message_of("Break it"))
    assert main(["registry", "site", str(tmp_path / "out"), "--registry", str(copy)]) == 1
    assert "9 entries" in capsys.readouterr().out
    told = text(tmp_path / "out" / "index.html")
    assert "1 that cannot be read" in told
    assert "dji/broken/1x1" in told


def test_an_empty_registry_says_what_to_do(tmp_path: Path) -> None:
    assert main(["registry", "init", str(tmp_path / "fleet")]) == 0
    assert main(["registry", "site", str(tmp_path / "out"), "--registry", str(tmp_path / "fleet")]) == 0
    assert "calibrary registry add FILE puts one in" in text(tmp_path / "out" / "index.html")
    assert (tmp_path / "out" / MARKER).is_file()


def test_an_entry_out_of_its_place_gets_a_page_that_is_nobody_elses() -> None:
    assert Place.of("cameras/dji/x/1x1.yaml", proper=True).page == "cameras/dji/x/1x1.html"
    for path in ("cameras/../../etc/x/y.yaml", "cameras/a/b/../../c.yaml", "cameras/A B/c/d.yaml"):
        place = Place.of(path, proper=True)
        assert re.fullmatch(r"cameras/elsewhere/[0-9a-f]{16}\.html", place.page)
    assert Place.of("cameras/dji/x/1x1.yaml", proper=False).page.startswith("cameras/elsewhere/")


def test_ways_between_pages_are_relative() -> None:
    assert way("cameras/a/b/c.html", "index.html") == "../../../index.html"
    assert way("index.html", "cameras/a/b~1/c+f8.html") == "cameras/a/b~1/c+f8.html"


def test_the_command_says_where_to_look(
    registry: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["registry", "site", str(out), "--registry", str(registry), "--workers", "1"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert f"open {out / 'index.html'}" in said.out
    assert Status.APPROVED.value in text(out / "index.html")
