"""Excitation trajectories: criteria, optimisers, designs."""
