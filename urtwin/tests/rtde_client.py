"""A small RTDE client for tests: it reads every package, and says what it got."""

import socket
import time

import numpy as np

from dynid.protocol import Framer, Kind, Recipe, rtde

TIMEOUT_S = 20.0
"""A wait that ends here has failed."""


class RtdeClient:
    def __init__(self, host, protocol=2):
        self.socket = socket.create_connection((host, rtde.PORT), timeout=TIMEOUT_S)
        self._framer, self._packets = Framer(), []
        self.texts = []
        self.protocol = 1
        self.inputs = {}
        if protocol != 1:
            try:
                self.socket.sendall(rtde.request_protocol(protocol))
                assert rtde.read_answer(self.reply(Kind.REQUEST_PROTOCOL_VERSION))
            except OSError:
                self.socket.close()
                raise
            self.protocol = protocol

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()

    def packet(self):
        while not self._packets:
            data = self.socket.recv(65536)
            if not data:
                raise ConnectionError(f"the controller hung up; it said {self.texts}")
            self._packets += self._framer.feed(data)
        return self._packets.pop(0)

    def reply(self, kind):
        while True:
            found, payload = self.packet()
            if found == kind:
                return payload
            if found == Kind.TEXT_MESSAGE:
                self.texts.append(rtde.read_text_message(payload, self.protocol))

    def read_outputs(self, names, frequency=500.0):
        self.socket.sendall(rtde.request_outputs(names, None if self.protocol == 1 else frequency))
        number, types = rtde.read_setup_answer(
            Kind.SETUP_OUTPUTS, self.reply(Kind.SETUP_OUTPUTS), self.protocol
        )
        self.recipe = Recipe.of(names, types, number)

    def claim(self, *names):
        self.socket.sendall(rtde.request_inputs(names))
        number, types = rtde.read_setup_answer(
            Kind.SETUP_INPUTS, self.reply(Kind.SETUP_INPUTS), self.protocol
        )
        recipe = Recipe.of(names, types, number)
        self.inputs[names] = recipe
        return recipe

    def write(self, *values):
        (recipe,) = self.inputs.values()
        self.socket.sendall(recipe.packet(values))

    def start(self):
        self.socket.sendall(rtde.frame(rtde.Kind.START))
        assert rtde.read_answer(self.reply(Kind.START))

    def row(self):
        return self.recipe.unpack(self.reply(Kind.DATA_PACKAGE))

    def rows(self, count):
        """So many packages as a table, an entry for each variable."""
        layout = [
            (name, kind.code, (kind.count,) if kind.count > 1 else ())
            for name, kind in zip(self.recipe.names, self.recipe.types, strict=True)
        ]
        return np.array([tuple(self.row().values()) for _ in range(count)], dtype=layout)

    def until(self, condition, cycles=20_000):
        """The first row for which a condition holds; rows are counted, not seconds."""
        for _ in range(cycles):
            row = self.row()
            if condition(row):
                return row
        raise AssertionError(f"not within {cycles} packages; last: {row}, said: {self.texts}")


def ask_dashboard(host, *commands):
    """The replies of the dashboard, greeting left out."""
    with (
        socket.create_connection((host, 29999), timeout=TIMEOUT_S) as sock,
        sock.makefile() as lines,
    ):
        lines.readline()
        replies = []
        for command in commands:
            sock.sendall(command.encode() + b"\n")
            replies.append(lines.readline().rstrip("\n"))
    return replies


def send_script(host, text, port=30002):
    with socket.create_connection((host, port), timeout=TIMEOUT_S) as sock:
        sock.sendall(text.encode())
        sock.shutdown(socket.SHUT_WR)
        # To close with something unread would break the connection and lose the text.
        while sock.recv(65536):
            pass


def wait_for(condition, what):
    """Wait until a condition holds; its last value."""
    end = time.monotonic() + TIMEOUT_S
    while not (found := condition()):
        if time.monotonic() > end:
            raise AssertionError(f"still not: {what}")
        time.sleep(0.005)
    return found
