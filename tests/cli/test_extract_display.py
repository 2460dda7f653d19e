"""What a pilot reads: every camera with its verdict and the way out, in whatever width the terminal has."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console
from rich.text import Text

from calibrary.cli.console import Screen
from calibrary.cli.extract_display import WIDEST, Display, judgement, verdict
from calibrary.jobs.extract.outputs import plan
from calibrary.jobs.extract.report import ExtractReport
from calibrary.validation import Verdict
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, gate, matrix, picture


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> ExtractReport:
    """A camera of each verdict, and a file that is no image."""
    folder = tmp_path_factory.mktemp("flight")
    picture(folder / "b.jpg", dewarp=DEWARP, **P4R)
    picture(folder / "a.jpg", (4000, 3000), make="Acme", model="Nine", focal_mm=(0, 0))
    picture(folder / "c.jpg", (5472, 3648), **P4R | {"digital_zoom": (2, 1)})
    (folder / "torn.jpg").write_bytes(b"\xff\xd8\xff")
    return gate(folder)


def lines(outcome: ExtractReport, width: int) -> list[str]:
    written = io.StringIO()
    console = Console(file=written, width=width)
    console.print(judgement(outcome, width=min(width, WIDEST)), highlight=False)
    return [line.rstrip() for line in written.getvalue().splitlines()]


def shown(outcome: ExtractReport, folder: Path, width: int = 100, *, explain: bool = True) -> str:
    written = io.StringIO()
    screen = Screen(file=written, width=width)
    with Display(screen, screen) as display:
        report = plan(outcome, folder / "K_matrix.npy")
        display.show(report, program=None, dry_run=True, explain=explain)
    return written.getvalue()


def heads(expected: list[str]) -> list[str]:
    """The verdict that each camera's first line begins with."""
    return [word for line in expected if line and (word := line.split(" ")[0]) in set(Verdict)]


@pytest.mark.parametrize("width", [60, 80, 100, 200])
def test_no_line_is_wider_than_the_terminal_and_no_verdict_is_cut(outcome: ExtractReport, width: int) -> None:
    printed = lines(outcome, width)
    assert max(map(len, printed)) <= min(width, WIDEST)
    assert heads(printed) == [*Verdict]


@pytest.mark.parametrize("width", [60, 80, 100, 200])
def test_the_same_is_told_in_every_width(outcome: ExtractReport, width: int) -> None:
    def words(printed: list[str]) -> list[str]:
        return [word for word in " ".join(printed).split() if "─" not in word]

    assert sorted(words(lines(outcome, width))) == sorted(words(lines(outcome, 110)))


def test_cameras_that_need_attention_come_last(outcome: ExtractReport) -> None:
    assert [c.verdict for c in outcome.judged] != [*Verdict]
    assert heads(lines(outcome, 100)) == ["valid", "unproven", "rejected"]


def test_what_unproven_means_is_explained_below_the_cameras(outcome: ExtractReport) -> None:
    printed = lines(outcome, 100)
    explained = printed.index("unproven: plausible, but no second source confirms it, or one contradicts it")
    assert explained > max(printed.index(line) for line in printed if line.startswith("rejected"))


def test_the_last_line_counts_the_verdicts(outcome: ExtractReport, tmp_path: Path) -> None:
    last = shown(outcome, tmp_path).splitlines()[-1]
    assert (
        last == "3 cameras, judged by the fleet policy: 1 valid, 1 unproven, 1 rejected; 1 of 4 images unread"
    )
    assert Text.from_markup(verdict(outcome)).plain == last


def test_k_and_where_it_is_from_stand_below_the_camera(outcome: ExtractReport) -> None:
    printed = lines(outcome, 100)
    below = printed.index(next(line for line in printed if line.startswith("valid")))
    assert printed[below + 1].split() == ["fx", "3660.50", "fy", "3655.25", "cx", "2731.50", "cy", "1846.75"]
    assert printed[below + 2].strip() == "from drone-dji:DewarpData"


def test_a_camera_without_a_k_shows_no_number(outcome: ExtractReport) -> None:
    printed = lines(outcome, 100)
    head = next(line for line in printed if line.startswith("rejected"))
    assert head.split()[-2:] == ["—", "—"]


def test_what_to_do_is_said_once_and_follows_the_reason(outcome: ExtractReport) -> None:
    for camera in outcome.judged:
        if camera.verdict is not Verdict.VALID:
            assert camera.reason is not None
            assert camera.advice is not None
            assert camera.advice not in camera.reason
            printed = " ".join(" ".join(lines(outcome, 100)).split())
            assert f"{camera.reason} → {camera.advice}" in printed


def test_a_camera_that_needs_attention_names_its_images(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        picture(tmp_path / f"{name}.jpg", **NOBODY)
    assert "          images: a.jpg and 2 more" in lines(gate(tmp_path), 80)


def test_a_focal_length_of_0_0_is_not_blamed_on_the_sensor(outcome: ExtractReport) -> None:
    rejected = next(c for c in outcome.judged if c.verdict is Verdict.REJECTED)
    assert rejected.reason == "EXIF FocalLength is 0/0, expected a number above 0"
    assert rejected.advice is not None
    assert "sensor" not in rejected.advice
    assert all(way in rejected.advice for way in ("--registry", "--fallback-k"))


def test_a_camera_without_a_model_is_not_sent_to_the_registry(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg")
    [camera] = gate(tmp_path).judged
    assert camera.advice is not None
    assert "regist" not in camera.advice


def test_an_assumed_sensor_is_named_with_its_size_and_both_ways_out(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **NOBODY)
    [camera] = gate(tmp_path).judged
    assert camera.reason is not None
    assert camera.advice is not None
    assert "13.2 × 8.8 mm" in camera.reason
    assert "--sensor One=WxH" in camera.advice
    assert "--registry" in camera.advice


def test_a_sensor_nobody_stated_comes_before_what_follows_from_it(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **NOBODY | {"focal_mm": (50, 10)})
    [camera] = gate(tmp_path).judged
    assert camera.verdict is Verdict.REJECTED
    assert camera.advice is not None
    assert camera.advice.startswith("name the sensor")


def test_a_k_that_stands_in_says_for_what(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", make="Acme", model="Nine")
    outcome = gate(tmp_path, fallback_k=matrix(tmp_path / "K.npy", 3660.0))
    printed = " ".join(" ".join(lines(outcome, 100)).split())
    assert "K.npy is used; the images alone give no valid K: no EXIF FocalLength" in printed


def test_one_seed_is_told_with_its_commands_and_several_by_where_they_stand(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg")
    one = gate(tmp_path)
    assert "feature_extractor" in shown(one, tmp_path)
    picture(tmp_path / "b.jpg", (4000, 3000))
    several = shown(gate(tmp_path), tmp_path)
    assert "feature_extractor" not in several
    assert "from the report" in several


def test_every_step_of_the_fallbacks_is_told(outcome: ExtractReport, tmp_path: Path) -> None:
    printed = shown(outcome, tmp_path)
    for camera in outcome.judged:
        for step in camera.fallback.steps if camera.fallback is not None else ():
            assert step.step.value in printed
            assert step.outcome.value in printed


def test_a_files_name_cannot_drive_the_terminal(tmp_path: Path) -> None:
    (tmp_path / "a\x1b[2J[red]\n.jpg").write_bytes(b"")
    picture(tmp_path / "b.jpg", dewarp=DEWARP, **P4R)
    printed = shown(gate(tmp_path), tmp_path)
    assert "\x1b" not in printed
    assert "a\\x1b[2J[red]\\x0a.jpg" in printed


def test_a_long_list_of_skipped_images_is_cut_and_says_so(tmp_path: Path) -> None:
    for number in range(15):
        (tmp_path / f"{number}.jpg").write_bytes(b"")
    printed = lines(gate(tmp_path), 80)
    assert "15 images cannot be read" in printed
    assert printed[-1] == "  … and 3 more, listed in the report"
