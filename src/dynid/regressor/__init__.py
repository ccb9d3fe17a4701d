"""What every torque is made of: the columns that multiply the parameters."""
