"""The ground floor: errors, arrays, notices, provenance, optional dependencies."""
