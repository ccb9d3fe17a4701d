"""Workers beside the calling process: who takes part, and what a dead one costs."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from dynid.core import InputError, Workers, each, workers

sys.path.insert(0, str(Path(__file__).parents[1] / "excitation"))
ITEMS = list(range(12))


def square(value: int) -> int:
    return value * value


def fatal(folder: str) -> int:
    """The first process that takes this, other than the caller's, dies of it."""
    mark, caller = folder.split("|")
    if os.getpid() != int(caller):
        try:
            os.close(os.open(mark, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return 7
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.02)
    return 7


@pytest.fixture(scope="module")
def cluster() -> Generator[Any]:
    """The address of a scheduler of two workers in processes of their own."""
    distributed: Any = pytest.importorskip("distributed")
    # Port 0: with None the scheduler still asks for 8787, and warns where that is taken.
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0"
    ) as found:
        yield found


def test_each_item_once_wherever_it_ran() -> None:
    told: list[tuple[str, float]] = []
    with workers() as nobody:
        found = dict(each(square, ITEMS, nobody, tell=lambda *a: told.append(a), words="squares"))
    assert found == {k: k * k for k in ITEMS}
    assert [share for _, share in told] == pytest.approx([(k + 1) / 12 for k in ITEMS])
    assert told[0][0] == "squares"


def process_of(_item: int) -> int:
    return os.getpid()


def test_of_few_items_the_calling_process_takes_one() -> None:
    with workers(2) as beside:
        found = dict(each(process_of, [1, 2], beside))
    assert len(set(found.values())) == 2
    assert os.getpid() in found.values()


def test_what_a_task_raises_is_raised_here() -> None:
    with workers() as nobody, pytest.raises(TypeError):
        list(each(square, ["a"], nobody))  # type: ignore[list-item]


def test_local_processes_and_one_that_is_killed(tmp_path: Path) -> None:
    with workers(2) as found:
        assert dict(each(square, ITEMS, found)) == {k: k * k for k in ITEMS}
        mark = f"{tmp_path / 'dead'}|{os.getpid()}"
        assert dict(each(fatal, [mark] * 40, found)) == dict.fromkeys(range(40), 7)
        assert (tmp_path / "dead").exists()
        assert found.reopened == 1


def test_a_cluster_and_a_worker_that_is_killed(cluster: Any, tmp_path: Path) -> None:
    with workers(dask=cluster.scheduler_address) as found:
        assert found.slots == 2
        assert dict(each(square, ITEMS, found)) == {k: k * k for k in ITEMS}
        mark = f"{tmp_path / 'dead'}|{os.getpid()}"
        assert dict(each(fatal, [mark] * 40, found)) == dict.fromkeys(range(40), 7)
        assert (tmp_path / "dead").exists()


def test_starts_of_a_design_on_a_cluster(cluster: Any) -> None:
    problem = importlib.import_module("design_arms").problem
    multistart = importlib.import_module("dynid.excitation.searches")
    effort = importlib.import_module("dynid.excitation").Effort(starts=3)
    alone = multistart.multistart(problem(), effort, seed=1)
    with workers(dask=cluster.scheduler_address) as found:
        beside = multistart.multistart(problem(), effort, seed=1, beside=found)
    assert beside.best.objective == alone.best.objective
    assert beside.evaluations == alone.evaluations


ORPHANS = """
import os, signal, sys
sys.path.insert(0, {folder!r})
from dynid.core import workers
from test_parallel import process_of
if __name__ == "__main__":
    with workers(2) as beside:
        print(beside.submit(process_of, 1).result(), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
"""


def test_workers_end_with_a_process_that_is_killed(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(ORPHANS.format(folder=str(Path(__file__).parent)))
    # The worker has our end of the pipe too: it closes when both have ended.
    done = subprocess.run([sys.executable, script], capture_output=True, timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL
    assert int(done.stdout) > 0


class Closed:
    """A client whose scheduler is gone: nothing comes back, and nothing is taken."""

    handed = 0

    def submit(self, _task: Any, *_words: Any) -> Any:
        client: Any = pytest.importorskip("distributed").client
        self.handed += 1
        if self.handed > 1:
            raise client.ClosedClientError
        future: Any = importlib.import_module("concurrent.futures").Future()
        future.set_exception(client.ClosedClientError())
        return future


def test_without_its_scheduler_all_runs_here() -> None:
    found = dict(each(square, ITEMS, Workers(Closed(), 2)))  # type: ignore[arg-type]
    assert found == {k: k * k for k in ITEMS}


@pytest.mark.parametrize(
    "address", ["nonsense", "12345", "", "http://127.0.0.1:8786", "/tmp/x", "h:\N{SUPERSCRIPT TWO}"]
)
def test_an_address_without_a_port_is_refused_at_once(address: str) -> None:
    with pytest.raises(InputError, match="HOST:PORT"), workers(1, address):
        pass


class Here:
    """Workers that run at once what they are given, and count how often."""

    handed = 0

    def submit(self, task: Any, *words: Any) -> Any:
        self.handed += 1
        future: Any = importlib.import_module("concurrent.futures").Future()
        future.set_result(task(*words))
        return future


def test_short_tasks_are_handed_over_many_at_a_time() -> None:
    other = Here()
    found = dict(each(square, list(range(1000)), Workers(other, 2)))  # type: ignore[arg-type]
    assert found == {k: k * k for k in range(1000)}
    # Fewer items at a time towards the end.
    assert 20 < other.handed < 100


class Empty:
    """A cluster that lost all its workers: nothing is ever done."""

    def submit(self, task: Any, *words: Any) -> Any:
        return importlib.import_module("concurrent.futures").Future()


def test_a_cluster_without_workers_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynid.core.parallel.POLL_S", 0.01)
    monkeypatch.setattr("dynid.core.parallel.GONE_S", 0.03)
    gone = Workers(Empty(), 2, present=lambda: 0)  # type: ignore[arg-type]
    assert dict(each(square, ITEMS, gone)) == {k: k * k for k in ITEMS}
    assert gone.executor is None


def test_what_cannot_be_opened_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for jobs in (0, 2.5):
        with pytest.raises(InputError, match="jobs"), workers(jobs):  # type: ignore[arg-type]
            pass
    pytest.importorskip("distributed")
    monkeypatch.setattr("dynid.core.parallel.DASK_TIMEOUT_S", 0.5)
    with pytest.raises(InputError, match="no Dask scheduler"), workers(1, "tcp://127.0.0.1:9"):
        pass


def test_dynid_does_not_open_processes_to_be_imported() -> None:
    code = "import sys, dynid.core; sys.exit('multiprocessing' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
