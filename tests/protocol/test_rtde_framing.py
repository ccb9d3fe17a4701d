"""Packets are found in any stream, and nonsense is refused before it is stored."""

import itertools
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynid.protocol import Framer, Kind, Packet, ProtocolError
from dynid.protocol.rtde import KINDS, frame

PACKETS = st.lists(
    st.builds(Packet, st.sampled_from(sorted(Kind)), st.binary(max_size=300)), max_size=8
)


@given(packets=PACKETS, cuts=st.lists(st.integers(0, 3000), max_size=12))
def test_any_cutting_of_the_stream_gives_the_same_packets(packets, cuts):
    stream = b"".join(frame(*packet) for packet in packets)
    edges = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    framer, found = Framer(), []
    for start, end in itertools.pairwise(edges):
        found += framer.feed(stream[start:end])
    assert found == packets
    assert framer.pending == 0


def test_the_header_counts_itself():
    assert frame(Kind.START) == b"\x00\x03S"
    assert frame(Kind.REQUEST_PROTOCOL_VERSION, b"\x00\x02") == b"\x00\x05V\x00\x02"


@pytest.mark.parametrize("size", [0, 1, 2, 4097, 65535])
def test_an_impossible_size_is_refused_at_its_header(size):
    with pytest.raises(ProtocolError, match=f"got {size} bytes; allowed: 3 to 4096 bytes"):
        Framer(4096).feed(struct.pack(">HB", size, Kind.START))


@given(letter=st.integers(0, 255).filter(lambda letter: letter not in KINDS))
def test_an_unknown_type_is_refused_at_its_header(letter):
    with pytest.raises(ProtocolError, match="type is unknown"):
        Framer().feed(struct.pack(">HB", 20, letter))


def test_what_is_held_never_exceeds_one_packet():
    framer = Framer(4096)
    stream = frame(Kind.TEXT_MESSAGE, bytes(4000)) * 300
    for start in range(0, len(stream), 1000):
        framer.feed(stream[start : start + 1000])
        assert framer.pending < 4096


def test_a_payload_that_no_header_can_name_is_refused():
    with pytest.raises(ProtocolError, match="too large"):
        frame(Kind.DATA_PACKAGE, bytes(65535))
