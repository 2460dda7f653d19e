"""The door as a whole: what is public, how light it is, and how it is typed."""

from __future__ import annotations

import importlib.util
import inspect
import subprocess
import sys
from importlib import resources
from importlib.metadata import version

import pytest

import calibrary


def test_every_public_name_is_there_and_none_is_a_module() -> None:
    for name in calibrary.__all__:
        assert not inspect.ismodule(getattr(calibrary, name)), name
        assert name == "__version__" or importlib.util.find_spec(f"calibrary.{name}") is None, name
    assert set(dir(calibrary)) >= set(calibrary.__all__)


def test_a_name_that_is_not_there_is_said_to_be_missing() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'reed'"):
        _ = calibrary.reed  # type: ignore[attr-defined]


def test_the_version_is_the_distributions() -> None:
    assert calibrary.__version__ == version("calibrary")


def test_importing_it_loads_neither_numpy_nor_a_module_of_its_own() -> None:
    code = "import sys, calibrary; print(*sorted(m for m in sys.modules if m.startswith(('numpy', 'calibrary'))))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["calibrary"]


def test_type_checkers_are_told_to_look() -> None:
    """What they then see is in typed_use.py, which `make lint` reads strictly."""
    assert resources.files(calibrary).joinpath("py.typed").is_file()
