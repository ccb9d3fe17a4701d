"""Whatever moves a robot along a motion and records it: simulated, replayed, real."""
