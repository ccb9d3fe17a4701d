"""What clients see: no package lost, in real time or virtual; one seed, one record."""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from dynid.protocol import Kind, rtde
from rtde_client import RtdeClient, ask_dashboard, send_script, wait_for
from urtwin import controller_process

FIELDS = [
    "timestamp",
    "target_q",
    "actual_q",
    "actual_qd",
    "actual_current",
    "joint_temperatures",
    "runtime_state",
    "robot_mode",
    "output_int_register_24",
]
STEP_ERROR = 1e-12
"""Rounding of a difference of two times below 1000 s [s]."""
BEGUN = 40
SWING = """def swing():
  k = 0
  while k < 200:
    x = 0.3 * (1 - cos(k * 0.03))
    write_output_integer_register(24, k + 1)
    servoj([x, -1.5707963, 0, -1.5707963, 0, x], t=0.008, lookahead_time=0.03, gain=500)
    k = k + 1
  end
end
"""


def steps(rows):
    return np.diff(rows["timestamp"])


@pytest.mark.realtime
@pytest.mark.parametrize(("which", "rate"), [("real", 125.0), ("real_e", 500.0)])
def test_real_time_brings_every_cycle_at_its_time(which, rate, request):
    controller = request.getfixturevalue(which)
    assert controller.rate_hz == rate
    with RtdeClient(controller.host) as client:
        client.read_outputs(FIELDS)
        client.start()
        client.row()
        begin = time.monotonic()
        rows = client.rows(round(rate))
        wall = time.monotonic() - begin
    np.testing.assert_allclose(steps(rows), 1 / rate, rtol=0, atol=STEP_ERROR)
    # Wide: the machine may be busy. Neither free-running nor standing still is within it.
    assert 0.7 < wall < 3.0


def test_two_clients_see_the_same_numbers_and_a_slower_one_every_second(fast):
    with RtdeClient(fast.host) as one, RtdeClient(fast.host) as two:
        one.read_outputs(FIELDS)
        two.read_outputs(FIELDS, 62.5)
        one.start()
        two.start()
        # Virtual time waits for both: read in turn, each would wait for the other.
        with ThreadPoolExecutor() as pool:
            reading = pool.submit(one.rows, 300), pool.submit(two.rows, 150)
        a, b = (each.result() for each in reading)
    np.testing.assert_allclose(steps(a), 0.008, rtol=0, atol=STEP_ERROR)
    np.testing.assert_allclose(steps(b), 0.016, rtol=0, atol=STEP_ERROR)
    both, in_a, in_b = np.intersect1d(a["timestamp"], b["timestamp"], return_indices=True)
    assert len(both) > 50
    assert a[in_a].tobytes() == b[in_b].tobytes()


def test_protocol_one_streams(fast):
    with RtdeClient(fast.host, protocol=1) as client:
        client.read_outputs(FIELDS)
        client.start()
        np.testing.assert_allclose(steps(client.rows(50)), 0.008, rtol=0, atol=STEP_ERROR)


def test_the_acknowledgement_of_start_comes_before_the_first_package(fast):
    with RtdeClient(fast.host) as client:
        client.read_outputs(FIELDS)
        for _ in range(50):
            client.socket.sendall(rtde.frame(rtde.Kind.START))
            assert client.packet().kind == Kind.START
            client.socket.sendall(rtde.frame(rtde.Kind.PAUSE))
            client.reply(Kind.PAUSE)


def test_inputs_come_back_and_a_second_writer_is_told(fast):
    with RtdeClient(fast.host) as one, RtdeClient(fast.host) as two:
        one.claim("input_int_register_24")
        with pytest.raises(Exception, match="input_int_register_24 IN_USE"):
            two.claim("input_int_register_24")
        one.read_outputs(["timestamp", "input_int_register_24"])
        one.start()
        for value in (5, -6, 7):
            one.write(value)
            one.until(lambda row, value=value: row["input_int_register_24"] == value)

    def free():
        with RtdeClient(fast.host) as other:
            try:
                return other.claim("input_int_register_24")
            except Exception:
                return None

    wait_for(free, "the input is free once its client has left")


@pytest.mark.realtime
def test_virtual_time_waits_for_a_slow_reader_and_is_faster_than_real(fast):
    with RtdeClient(fast.host) as client:
        client.read_outputs(FIELDS)
        client.start()
        client.row()
        begin = time.monotonic()
        rows = client.rows(2000)
        assert (rows["timestamp"][-1] - rows["timestamp"][0]) > 2 * (time.monotonic() - begin)
        seen = []
        for _ in range(40):
            seen.append(client.row()["timestamp"])
            time.sleep(0.005)
        np.testing.assert_allclose(np.diff(seen), 0.008, rtol=0, atol=STEP_ERROR)
        # No package of the past is left: the controller has waited, not queued.
        client.claim("input_int_register_24")
        client.write(99)
        late = 0
        client.read_outputs(["timestamp", "input_int_register_24"])
        while client.row()["input_int_register_24"] != 99:
            late += 1
        assert late <= 4


@pytest.mark.realtime
def test_the_same_seed_gives_the_same_record_in_real_and_in_virtual_time():
    records = []
    for virtual in (False, True):
        with controller_process(hold=True, seed=7, virtual_time=virtual) as controller:
            send_script(controller.host, SWING)
            wait_for(
                lambda host=controller.host: (
                    ask_dashboard(host, "programState") == ["PLAYING swing"]
                ),
                "the program is compiled",
            )
            with RtdeClient(controller.host) as client:
                client.read_outputs(FIELDS)
                client.start()
                records.append(client.rows(250))
    real, virtual = records
    index = virtual["output_int_register_24"]
    assert list(np.unique(index[index > 0])) == list(range(1, 201))
    assert np.ptp(virtual["actual_q"][:, 0]) > 0.5
    assert real.tobytes() == virtual.tobytes()


@pytest.mark.realtime
@pytest.mark.parametrize("rate", [125.0, 500.0])
def test_set_points_streamed_in_virtual_time_are_neither_skipped_nor_repeated(rate):
    """One for each package, as fast as the client can: bunched, delayed, never lost."""
    echo = """def echo():
  while True:
    write_output_integer_register(24, read_input_integer_register(24))
    write_output_float_register(24, read_input_float_register(24))
    sync()
  end
end
"""
    with (
        controller_process(virtual_time=True, rate_hz=rate) as controller,
        RtdeClient(controller.host) as client,
    ):
        client.read_outputs(["timestamp", "output_int_register_24", "output_double_register_24"])
        client.claim("input_int_register_24", "input_double_register_24")
        client.start()
        send_script(controller.host, echo)
        seen = []
        for k in range(1, 1001):
            seen.append(client.row())
            client.write(k, 0.5 * k)
            if k % 100 == 0:
                # Late, though not as late as a client that has stopped to stream.
                time.sleep(0.004)
        client.until(lambda row: seen.append(row) or row["output_int_register_24"] == 1000)
    index = np.array([row["output_int_register_24"] for row in seen])
    assert np.diff(index).max() == 1
    # It takes a few packages to know a stream by.
    assert set(np.diff(index[index >= BEGUN])) == {1}
    assert all(
        row["output_double_register_24"] == 0.5 * row["output_int_register_24"] for row in seen
    )


@pytest.mark.realtime
def test_virtual_time_goes_on_when_a_client_ends_its_stream(fast):
    with RtdeClient(fast.host) as client:
        client.read_outputs(["timestamp"])
        client.claim("input_double_register_25")
        client.start()
        for _ in range(20):
            client.row()
            client.write(1.0)
        walls, times = [time.monotonic()], [client.row()["timestamp"]]
        for _ in range(4):
            times.append(client.rows(250)["timestamp"][-1])
            walls.append(time.monotonic())
    assert walls[1] - walls[0] < 3.0, "the next set point was waited for, not long"
    # The fastest stretch: others may hold one up, and at the wall clock's pace none would be fast.
    assert max(np.diff(times[1:]) / np.diff(walls[1:])) > 2
