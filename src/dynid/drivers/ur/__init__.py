"""UR robots: the link, the state, the program, the stream, and what stops them."""
