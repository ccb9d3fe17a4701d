"""Simulated controllers for the driver's tests: one address each, on loopback."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from dynid.core import Array
from dynid.drivers.ur.link import Disconnected, RtdeLink
from dynid.drivers.ur.variables import APPROACHING, MOVING, STATE, Layout, recorded_names
from dynid.protocol import Numbers


@dataclass
class Observer:
    """Another client, which sees what the simulated robot does whatever becomes of the first."""

    host: str
    packages: list[Numbers] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._link = RtdeLink(self.host)
        self.layout = Layout.of(self._link.ask_outputs(recorded_names(self._link.version[:3])))
        self._stop = threading.Event()
        self._news = threading.Condition()
        self._go = threading.Event()
        self._go.set()
        self._idle = threading.Event()
        self._gone = False
        self._link.start()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        try:
            while not self._stop.is_set():
                if not self._go.is_set():
                    self._idle.set()
                    self._go.wait()
                    self._idle.clear()
                found = self._link.packages()
                with self._news:
                    self.packages += found
                    self._news.notify_all()
        except Disconnected:
            pass
        finally:
            with self._news:
                self._gone = True
                self._news.notify_all()

    @contextmanager
    def time_stands_still(self) -> Iterator[None]:
        """Virtual time waits for all its clients: this one reads no more."""
        self._go.clear()
        try:
            # What it was reading has come: no package is newer than those that are seen.
            assert self._idle.wait(30.0)
            yield
        finally:
            self._go.set()

    def wait_for(self, condition, timeout: float = 30.0) -> None:
        """Wait until a condition on the newest package holds."""
        with self._news:
            done = self._news.wait_for(
                lambda: self._gone or (self.packages and condition(self.packages[-1])), timeout
            )
        assert done, "the condition never came true"
        assert not self._gone, "the controller has gone"

    def wait_for_index(self, index: int) -> None:
        """Wait until our program, started after this observer, has reached a set point."""
        begun = False

        def reached(package: Numbers) -> bool:
            nonlocal begun
            state = self.number(package, STATE)
            # Registers keep what an earlier program left there.
            begun = begun or state == APPROACHING
            return begun and state == MOVING and self.index(package) >= index

        seen = 0

        def look(_: Numbers) -> bool:
            nonlocal seen
            new, seen = self.packages[seen:], len(self.packages)
            states = [reached(package) for package in new]
            return any(states)

        self.wait_for(look)

    def number(self, package: Numbers, name: str) -> float:
        return self.layout.number(package, name)

    def index(self, package: Numbers) -> int:
        return int(self.layout.number(package, "output_int_register_24"))

    def columns(self, *names: str) -> tuple[Array, ...]:
        """Variables of all packages until now, each (N) or (N, 6)."""
        with self._news:
            rows = list(self.packages)
        tables = [
            np.array([row[self.layout.places[name]] for row in rows], dtype=float) for name in names
        ]
        return tuple(table[:, 0] if table.shape[1] == 1 else table for table in tables)

    def column(self, name: str) -> Array:
        """One variable of all packages until now."""
        return self.columns(name)[0]

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._link.close()

    def __enter__(self) -> Observer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
