"""Pictures of designs, recordings and results, for the screen and for a paper."""
