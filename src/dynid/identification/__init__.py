"""Estimators, their statistics, and the choice of settings."""
