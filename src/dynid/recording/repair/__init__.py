"""From raw tables to recordings: what can be repaired is, and none of it silently."""
