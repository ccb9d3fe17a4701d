"""Base parameters: rank, regrouping, classes."""
