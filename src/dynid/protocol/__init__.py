"""What UR controllers say on the wire: codecs without sockets, for both sides."""
