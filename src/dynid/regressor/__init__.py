"""The regressor: inertial columns, friction columns, the inverse dynamic model."""
