"""What all tests share: how hypothesis runs, which tests run, what they may cost, and where bytecode is kept."""

from __future__ import annotations

import gc
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import pytest

if TYPE_CHECKING:
    from calibrary.jobs.demo.flight import DemoImage

if sys.dont_write_bytecode:
    # Some hundred tests start a Python, and each of them would compile numpy and the package anew. The sources stay
    # as clean as PYTHONDONTWRITEBYTECODE asks: bytecode goes where everything else that is built goes.
    sys.dont_write_bytecode = False
    sys.pycache_prefix = str(Path(__file__).parents[1] / "build" / "bytecode")
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# pytest rewrites and compiles all of it: five seconds of every process unless the bytecode is kept.
from hypothesis import settings

from tests.cpu import Meter, by_room, read_dear
from tests.thorough import THOROUGH

# The processors are busy with other tests: a second thread of BLAS only waits for the first, and burns time doing so.
# Before NumPy is imported; the programs that tests start inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No test, and no program that one starts, sees the developer's own registry; what looks for one unsets this.
os.environ["CALIBRARY_REGISTRY"] = "none"

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell starts what runs in its background deaf to Ctrl-C; the programs that tests interrupt must not inherit it.
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples in every run, so that a change is judged by what it changed; make test-thorough looks for new
# ones. A machine busy with something else is no failure: hangs are caught by the suite's own time.
settings.register_profile("steady", deadline=None, derandomize=True, max_examples=25)
settings.register_profile("thorough", deadline=None, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "steady"))


def pytest_configure(config: pytest.Config) -> None:
    """What costs too much fails; a thorough run may take its time."""
    config.addinivalue_line("markers", "thorough: a test of make test-thorough alone")
    config.addinivalue_line("markers", "walk: a test with a browser that is one of make test, too")
    config.pluginmanager.register(Meter(read_dear(), fails=not THOROUGH))
    gc.disable()  # until all is collected: looking through ever more tests takes seconds, and finds nothing


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is only for a thorough run: what is marked so, and what needs a browser but for a few walks."""
    left = [] if THOROUGH else [item for item in items if is_thorough(item)]
    if left:
        config.hook.pytest_deselected(items=left)
        items[:] = [item for item in items if not is_thorough(item)]


def is_thorough(item: pytest.Item) -> bool:
    """Whether only a thorough run has the time for a test."""
    in_a_browser = "browser" in getattr(item, "fixturenames", ()) and not item.get_closest_marker("walk")
    return in_a_browser or item.get_closest_marker("thorough") is not None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say what was used, and where."""
    reports = (report for reports in terminalreporter.stats.values() for report in reports)
    costs = [
        (report.nodeid, seconds)
        for report in reports
        if getattr(report, "when", None) == "teardown"
        for name, seconds in report.user_properties
        if name == "cpu"
    ]
    terminalreporter.write_line(by_room(costs))


def pytest_collection_finish() -> None:
    """What was collected stays to the end: no garbage collection looks at it again."""
    gc.collect()
    gc.freeze()
    gc.enable()


Flight: TypeAlias = "tuple[Path, list[DemoImage]]"


@pytest.fixture(scope="session")
def demo_flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """The flight of ``calibrary demo``, written once for all who only look at it."""
    from calibrary.jobs.demo.flight import write_flight

    out = tmp_path_factory.mktemp("demo") / "flight"
    return out, write_flight(out)


@pytest.fixture(scope="session")
def furnished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file for every example of a docstring; made once, not to be changed."""
    from tests.registry.git.repositories import seclude
    from tests.workshop import furnish

    folder = tmp_path_factory.mktemp("workshop")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, tmp_path_factory.mktemp("home"))
        furnish(folder)
    return folder


@pytest.fixture(autouse=True, scope="session")
def wide() -> None:
    """Help texts are not folded, so that a test can look for a sentence; tests of widths set their own."""
    os.environ["COLUMNS"] = "2000"
