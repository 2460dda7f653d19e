"""Every command that judges gives the labelled answer on every case, and no two contradict each other."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.jobs.fleet import create_registry
from tests.jobs.survey.cases import AGAINST, FOR, TABLE, Answer, Case, Folder, cases
from tests.registry.git.repositories import seclude


class Shelf:
    """Images and registries, each made once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.empty = folder / "empty"
        create_registry(self.empty)

    def images(self, case: Case) -> Path:
        folder = self.folder / case.family.name
        return folder if folder.exists() else case.family.images(folder)

    def registry(self, case: Case) -> Path | None:
        factor, folder = (
            TABLE["registries"][case.registry],
            self.folder / f"{case.family.name}-{case.registry}",
        )
        if factor is None or folder.exists():
            return None if factor is None else folder
        return case.family.registry(folder, factor)


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Shelf:
    folder = tmp_path_factory.mktemp("shelf")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        return Shelf(folder)


USES = {"extract", "onboard"}
"""Commands that use a file which a person put there and nothing contradicts; they do not call it right."""


def wrong(label: str | None, answers: dict[str, Answer]) -> list[str]:
    """The commands whose answer is not the label's, and those that contradict each other."""
    found = []
    for command, answer in answers.items():
        if (label in {"R", "r"} and answer == AGAINST) or (label == "X" and answer == FOR):
            found.append(f"{command} says {answer}, and it is {label}")
        if label == "o" and (answer == AGAINST or (answer == FOR and command not in USES)):
            found.append(f"{command} says {answer}, and nothing tells")
    if "check" in answers and label in {"R", "X", "o"}:
        expected = {"R": FOR, "X": AGAINST}.get(label)
        if answers["check"] != expected:
            found.append(f"check says {answers['check']}, expected {expected}")
    said = {answer for answer in answers.values() if answer is not None}
    if len(said) > 1:
        found.append(f"contradiction: {answers}")
    return found


@pytest.mark.parametrize("case", [*cases(), *cases("aside")], ids=lambda case: case.name)
def test_every_command_gives_the_labelled_answer(
    case: Case, shelf: Shelf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seclude(monkeypatch, shelf.folder)
    folder = Folder.laid_out(case, tmp_path / "flight", shelf.images(case), shelf.registry(case), shelf.empty)
    found = folder.answers()
    faults = wrong(case.expected, found.of_file) if case.file else []
    faults += [f"entry: {fault}" for fault in wrong(case.of_entry, found.of_entry)]
    assert not faults, "\n".join([*faults, *found.said])
