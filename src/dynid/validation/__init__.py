"""How well a model predicts another record."""
