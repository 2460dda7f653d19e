"""Reading on a cluster of worker processes, and what becomes of it when one of them is killed."""

from __future__ import annotations

import logging
import os
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.errors import InputError
from calibrary.jobs.extract.report import encode
from calibrary.jobs.images import reading
from calibrary.jobs.images.accumulator import Accumulator
from calibrary.jobs.images.listing import Listing
from calibrary.jobs.images.reading import (
    Question,
    Unit,
    batches,
    connected,
    here,
    on_cluster,
    read_images,
    read_unit,
)
from calibrary.records import to_json
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, gate, picture

# Dask's own threads and sockets are its own business.
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """A cluster of two processes."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    for number in range(120):
        tags = {**(P4R if number % 3 else NOBODY), "software": f"v{number % 4}"}
        picture(folder / f"{number:03}.jpg", dewarp=DEWARP if number % 2 else None, **tags)
    (folder / "broken.jpg").write_bytes(b"no image")
    return folder


def alone(folder: Path) -> Accumulator:
    images = Listing([folder], recursive=False)
    return read_images(images, engine=here(1, known=images.known)).images


@pytest.mark.thorough
def test_a_worker_that_is_killed_in_mid_run_changes_nothing(client: Any, flight: Path) -> None:
    killed: list[int] = []

    def kill_one(_read: int) -> None:
        if not killed:
            killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    images = Listing([flight], recursive=False)
    found = read_images(images, engine=on_cluster(client, merged=3), batch=5, progress=kill_one)
    assert killed
    assert found.lost == 0
    assert found.images.to_bytes() == alone(flight).to_bytes()
    assert found.images.settled() == alone(flight).settled()


class Future:
    """A task of Dask that ended."""

    def __init__(self, work: Callable[..., bytes], arguments: tuple[Any, ...]) -> None:
        parts = [one.result() if isinstance(one, Future) else one for one in arguments]
        self.value, self.status = b"", "finished"
        try:
            self.value = work(*([p.result() for p in one] if isinstance(one, list) else one for one in parts))
        except ProcessLookupError:
            self.status = "error"
        except HangsError:
            self.status = "pending"

    def result(self, timeout: float = 0) -> bytes:
        del timeout
        return self.value

    def exception(self, timeout: float) -> None:
        if self.status == "pending":
            raise TimeoutError(timeout)

    def cancel(self) -> None:
        self.status = "cancelled" if self.status == "pending" else self.status


class HangsError(Exception):
    """Raised by a task that never ends."""


class Ready(list[Future]):
    """Tasks as they end."""

    add = list.append

    def __iter__(self) -> Iterator[Future]:
        while self:
            ended = [future for future in list.__iter__(self) if future.status != "pending"]
            if ended:
                self.remove(ended[-1])
                yield ended[-1]
            else:
                time.sleep(0.01)


class Scheduler:
    """As much of a client as an engine uses; a task that raises ProcessLookupError has lost its workers."""

    loop = None

    def nthreads(self) -> dict[str, int]:
        return {"a": 1, "b": 1}

    def submit(self, work: Callable[..., bytes], *arguments: Any, pure: bool) -> Future:
        assert not pure
        return Future(work, arguments)


def test_a_piece_that_kills_its_workers_is_unread_and_takes_no_other_along(
    flight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "_distributed", lambda: SimpleNamespace(as_completed=lambda **_: Ready()))
    tried: Counter[str] = Counter()

    def read(unit: Unit) -> Accumulator:
        first = unit.images[0].name
        tried[first] += 1
        if first == "040.jpg" or (first in {"030.jpg", "050.jpg"} and tried[first] == 1):
            # Those beside it waited on the same worker and are blamed as well.
            raise ProcessLookupError
        return read_unit(unit, question=Question())

    images = Listing([flight], recursive=False)
    done = [*on_cluster(Scheduler(), merged=4)(read, batches(images, 10))]
    [lost] = [one for one in done if one.part is None]
    assert lost.unit is not None
    assert [image.name for image in lost.unit.images] == [f"{number:03}.jpg" for number in range(40, 50)]
    assert sum(one.count for one in done) == 121
    assert {first: count for first, count in tried.items() if count > 1} == {
        "030.jpg": 2,
        "040.jpg": 2,
        "050.jpg": 2,
    }
    merged = Accumulator()
    for one in done:
        if one.part is not None:
            merged.merge(one.part)
    assert sum(names.count for names in merged.settled().seen.values()) == 110


def test_what_hangs_is_given_up_and_what_was_read_is_kept(
    flight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A piece whose workers come up again and again never ends, and keeps a place from the others."""
    monkeypatch.setattr(reading, "_distributed", lambda: SimpleNamespace(as_completed=lambda **_: Ready()))
    monkeypatch.setattr(reading, "STALLED_S", 0.2)

    def read(unit: Unit) -> Accumulator:
        if unit.images[0].name == "040.jpg":
            raise HangsError
        return read_unit(unit, question=Question())

    images = Listing([flight], recursive=False)
    done = [*on_cluster(Scheduler(), merged=1)(read, batches(images, 10))]
    lost = [one.unit.images[0].name for one in done if one.part is None and one.unit is not None]
    assert lost == ["040.jpg"]
    assert sum(one.count for one in done) == 121


@pytest.mark.thorough
def test_the_report_is_that_of_one_process_byte_for_byte(
    client: Any, flight: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calibrary.jobs.extract.run.PIECE", 7)
    address = client.scheduler_info()["address"]
    assert encode(to_json(gate(flight, cluster=address))) == encode(to_json(gate(flight)))


def test_a_cluster_that_is_none_is_named() -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="no scheduler with workers") as told, connected("ray://host"):
        pass
    assert told.value.source == "ray://host"


def test_without_dask_the_command_that_brings_it_is_told(
    flight: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("calibrary.extras.find_spec", lambda _: None)
    assert main(["extract", str(flight), "--cluster", "tcp://host:8786", "--dry-run"]) == 2
    assert 'pip install "calibrary[cluster]"' in capsys.readouterr().err
    assert reading.PIECE == 10_000
