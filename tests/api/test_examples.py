"""Every public function of the door has an example in its docstring, and the example is true."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import calibrary
import calibrary.jobs
from calibrary import Calibration
from calibrary.api.tables import cameras
from calibrary.jobs.calibrate import write_board
from calibrary.jobs.files import with_interior_orientation

SOURCE_DOCUMENT = {"extract_intrinsic_matrix", "validate"}
"""As the source document has it, and a rule of the core: they read no file and are no part of the door."""

JOBS = {
    name: importlib.import_module(f"calibrary.jobs.{name}")
    for _, name, _ in pkgutil.iter_modules(calibrary.jobs.__path__)
}
"""The package of a job begins with a synopsis, as its docstring; one that holds parts of several jobs shows nothing."""
FACES = {
    job.__name__: job
    for job in JOBS.values()
    if any(getattr(vars(job)[name], "__module__", "") == job.__name__ for name in getattr(job, "__all__", ()))
}
FUNCTIONS = {
    name: getattr(calibrary, name)
    for name in calibrary.__all__
    if inspect.isfunction(function := getattr(calibrary, name))
    and name not in SOURCE_DOCUMENT
    and function.__module__ not in FACES
}
METHODS = {
    f"Calibration.{name}": getattr(Calibration, name) for name in ("to_opencv", "from_opencv", "to_colmap")
}
METHODS |= {
    f"Fleet.{name}": getattr(calibrary.Fleet, name)
    for name in ("resolve", "listing", "show", "check", "audit", "export", "propose")
}
METHODS |= {
    f"{function.__module__}.{function.__name__}": function
    for function in (
        cameras,
        with_interior_orientation,
        write_board,
    )
}
DOCUMENTED = {"calibrary": calibrary, **FUNCTIONS, **METHODS, **FACES}


def examples(documented: object, name: str) -> Iterator[doctest.DocTest]:
    finder = doctest.DocTestFinder(recurse=False)
    names = {"calibrary": calibrary, "Calibration": Calibration}
    yield from (test for test in finder.find(documented, name, globs=names) if test.examples)


@pytest.mark.parametrize("name", DOCUMENTED)
def test_the_example_is_true(
    name: str, furnished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(furnished, tmp_path / "work")
    monkeypatch.chdir(tmp_path / "work")
    found = list(examples(DOCUMENTED[name], name))
    assert found, f"{name} has no example"
    printed: list[str] = []
    for test in found:
        runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
        runner.run(test, out=printed.append)
        assert runner.failures == 0, "".join(printed)
