"""The sections of a report, one a file: each only shows what was computed before."""
