"""A simulated UR controller: real protocols in front of the simulated arm."""
