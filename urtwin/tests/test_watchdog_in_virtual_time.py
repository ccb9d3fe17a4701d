"""A watchdog bites by the controller's clock, and never before its real time is over."""

import time

import pytest

from rtde_client import RtdeClient, send_script

PERIOD_S, CYCLE_S = 0.1, 0.008
GUARDED = """def guarded():
  rtde_set_watchdog("input_int_register_24", 10, "stop")
  while True:
    write_output_integer_register(25, read_input_integer_register(24))
    sync()
  end
end
"""


@pytest.fixture
def client(fast):
    with RtdeClient(fast.host) as client:
        client.read_outputs(["timestamp", "runtime_state", "output_int_register_25"])
        client.claim("input_int_register_24")
        client.start()
        client.until(lambda row: row["runtime_state"] == 1)
        send_script(fast.host, GUARDED)
        client.until(lambda row: row["runtime_state"] == 2)
        yield client


def test_a_client_that_is_slow_by_the_wall_clock_feeds_in_time(client):
    start = client.row()["timestamp"]
    for value in range(1, 41):
        client.write(value)
        # Half the watchdog's time passes here, ten times as much in virtual time if it could.
        time.sleep(PERIOD_S / 2)
        row = client.until(lambda row, value=value: row["output_int_register_25"] == value)
        assert row["runtime_state"] == 2
    assert row["timestamp"] > start


def test_silence_stops_the_program_at_its_time(client):
    client.write(12345)
    fed = client.until(lambda row: row["output_int_register_25"] == 12345)["timestamp"]
    begin = time.monotonic()
    stopped = client.until(lambda row: row["runtime_state"] == 1)["timestamp"]
    assert stopped - fed == pytest.approx(PERIOD_S, abs=CYCLE_S)
    assert time.monotonic() - begin >= PERIOD_S / 2
