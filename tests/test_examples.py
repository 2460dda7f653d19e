"""Every public name and every job has an example in its docstring, and every example is true."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
import shutil
from pathlib import Path

import pytest

import calibrary
import calibrary.jobs
from calibrary import Calibration

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
PUBLIC = {name: getattr(calibrary, name) for name in calibrary.__all__ if callable(getattr(calibrary, name))}


def examples(documented: object, name: str) -> list[doctest.DocTest]:
    """The examples of a function, of a class and its methods, or of a module and what is in it."""
    names = {"calibrary": calibrary, "Calibration": Calibration}
    return [test for test in doctest.DocTestFinder().find(documented, name, globs=names) if test.examples]


EXAMPLES = {
    test.docstring: test
    for name, documented in {
        **FACES,
        "calibrary": calibrary,
        **PUBLIC,
    }.items()
    for test in examples(documented, name)
}
"""What is public both here and in its job is run once."""


LONG = {f"calibrary.jobs.{name}" for name in ("demo", "calibrate", "onboard", "undistort")}
"""Whose examples solve frames or read the whole demonstration flight: for a thorough run."""


def test_every_public_name_and_every_job_has_an_example() -> None:
    silent = {name for name, job in FACES.items() if ">>>" not in (job.__doc__ or "")}
    silent |= {
        name for name, one in PUBLIC.items() if one.__module__ not in FACES and not examples(one, name)
    }
    assert silent == set()


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(one, id=one.name, marks=[pytest.mark.thorough] if one.name in LONG else [])
        for one in EXAMPLES.values()
    ],
)
def test_the_example_is_true(
    example: doctest.DocTest, furnished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(furnished, tmp_path / "work")
    monkeypatch.chdir(tmp_path / "work")
    printed: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(example, out=printed.append)
    assert runner.failures == 0, "".join(printed)
