"""What a terminal shows of a result: each thing that is stated once, and a dash or nothing for what is not."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from rich.text import Text

from calibrary.calibration import Grade, Intrinsics, Quality
from calibrary.cli import onboard
from calibrary.cli.console import Screen
from calibrary.cli.terminal import show
from calibrary.distortion import BrownConrady
from calibrary.jobs.calibrate.told import _correlations, parameters
from calibrary.jobs.diff.verdicts import ChangeVerdict
from calibrary.jobs.images.folders import SkippedFile
from calibrary.jobs.onboard.report import (
    CameraDecision,
    Decision,
    Estimate,
    ImageSolve,
    Kind,
    OnboardReport,
    ProposedEntry,
    RelatedEntry,
    SortedFolder,
)
from calibrary.jobs.onboard.told import told
from calibrary.registry.entry import Status
from tests.registry.entries import KEY, an_entry, covariance

K = Intrinsics(fx=3661.25, fy=3658.75, cx=2731.5, cy=1831.25, image_size=(5472, 3648))


def screen() -> Screen:
    return Screen(file=io.StringIO(), width=300)


def lines(shown: Screen) -> list[str]:
    assert isinstance(shown.file, io.StringIO)
    return [" ".join(line.split()) for line in shown.file.getvalue().splitlines() if line.strip()]


def decision(**changed: Any) -> CameraDecision:
    return CameraDecision(camera=KEY, decision=Decision.PROPOSED, reason="The file is exact.", **changed)


def test_a_camera_of_a_payload_is_shown_with_its_estimates_and_its_relatives() -> None:
    shown = screen()
    estimates = (
        Estimate(
            kind=Kind.FILE,
            name="lab.xml",
            grade=Grade.CALIBRATED,
            intrinsics=K,
            measured_centre=True,
            chosen=True,
            limit=0.01,
        ),
        Estimate(kind=Kind.CATALOGUE, name="P4R", intrinsics=K, limit=0.02, difference=-0.004),
    )
    relatives = (
        RelatedEntry(
            id="dji/a", own=True, status=Status.APPROVED, verdict=ChangeVerdict.DRIFT, focal_change=2e-3
        ),
        RelatedEntry(id="dji/b", own=False, status=Status.APPROVED, reason="turned by 90°"),
    )
    board = ImageSolve(images=9, reason="too few views")
    one = decision(
        estimates=estimates, relatives=relatives, board=board, next="approve it", hint="fly a grid"
    )
    show(shown, told(report(one)))
    text = lines(shown)
    assert text[:3] == [f"{KEY} draft proposed", "The file is exact.", "→ approve it"]
    assert "lab.xml file calibrated 3661.25 3658.75 2731.50 1831.25 – proposed" in text
    assert "P4R catalogue – 3661.25 3658.75 – – −0.40% no K" in text
    assert f"dji/a this camera approved +0.200% – {ChangeVerdict.DRIFT.value}" in text
    assert "dji/b another approved – – turned by 90°" in text
    assert "9 frames of a board give no K: too few views." in text


def report(*cameras: CameraDecision, **changed: Any) -> OnboardReport:
    skipped = tuple(SkippedFile(name=f"{number}.txt", reason="no image") for number in range(9))
    folder = SortedFolder(images=1, board_frames=2, calibration_files=0, skipped=skipped)
    stated: dict[str, Any] = {"verdict": "good", "branches": {}}
    return OnboardReport(
        folder="f",
        registry="r",
        policy="fleet",
        sorted=folder,
        cameras=cameras,
        page=None,
        **(stated | changed),
    )


def test_a_payload_is_counted_and_of_many_files_that_were_skipped_eight_are_named() -> None:
    shown = screen()
    onboard._show(shown, report(), "report.html")
    page, count, _, *skipped, more, lead = lines(shown)
    assert count == "1 image of flights, 2 frames of a board, 0 calibration files, 9 skipped"
    assert skipped == [f"{number}.txt no image" for number in range(8)]
    assert (more, page) == ("1 more", "wrote report.html")
    assert lead == "no camera could be identified in the folder"


def test_where_one_of_several_cameras_was_refused_it_says_that_nothing_was_written() -> None:
    one, refused = decision(), decision()
    why = "nothing was written into the registry, since one was refused; --only TEXT takes one camera"
    for done, expected in (
        (report(one, refused, verdict="refused"), [why]),
        (report(refused, verdict="refused"), []),
        (report(one, one), []),
        (
            report(one, branches={"onboard/x": "a" * 40}),
            [
                "wrote 0 drafts on the branch onboard/x, aaaaaaaaaaaa",
                "then: calibrary registry approve --from onboard/x --registry fleet",
            ],
        ),
    ):
        shown = screen()
        onboard._show_written(shown, done, " --registry fleet")
        assert lines(shown) == expected


def test_a_draft_that_was_written_is_told_with_the_command_that_shows_it() -> None:
    entry, shown = an_entry(), screen()
    wrote = decision(entry=ProposedEntry.of(entry, None), branch="onboard/x")
    written = report(wrote, branches={"onboard/x": "a" * 40}, warnings=("unsigned",))
    onboard._show_written(shown, written, "")
    assert lines(shown) == [
        "wrote 1 draft on the branch onboard/x, aaaaaaaaaaaa",
        "note: unsigned",
        f"look at it: calibrary registry show {entry.id}@onboard/x",
        "then: calibrary registry approve --from onboard/x",
    ]


def test_correlations_are_covariances_in_units_of_the_standard_deviations() -> None:
    C = covariance()
    [table] = _correlations(Quality(covariance=C))
    sigma = np.sqrt(np.diag(C.matrix))
    for at, row in enumerate(table.rows):
        found = [cell for cell in row if cell]
        assert found == [
            C.names[at],
            *(f"{C.matrix[at, to] / sigma[at] / sigma[to]:+.2f}" for to in range(at)),
        ]


def test_a_parameter_is_shown_to_the_second_digit_of_its_standard_deviation() -> None:
    entry = an_entry(quality=Quality(std={"fx": 0.12, "cx": 12.0, "k1": 3e-5, "k2": 0.0}, kappa2=4.0))
    assert [*parameters(entry.calibration)][:6] == [
        ("fx", "3661.25", "0.12", "0.24"),
        ("fy", "3658.75", "–", "–"),
        ("cx", "2732", "12", "24"),
        ("cy", "1831.25", "–", "–"),
        ("k1", "−0.262000", "0.000030", "0.000060"),
        ("k2", "0.104", "–", "–"),
    ]
    bare = an_entry(distortion=BrownConrady(k1=-0.1, k2=0.0, p1=0.0, p2=0.0)).calibration
    assert [row[0] for row in parameters(bare)] == ["fx", "fy", "cx", "cy", "k1"]


def test_a_table_on_a_terminal_is_indented_and_in_a_pipe_it_has_no_blanks_at_the_ends() -> None:
    for terminal, expected in ((True, "  one  "), (False, "  one")):
        shown = Screen(file=io.StringIO(), width=300, force_terminal=terminal, color_system=None)
        shown.show([Text("one  ")], indent=2)
        assert isinstance(shown.file, io.StringIO)
        assert shown.file.getvalue() == f"{expected}\n"
