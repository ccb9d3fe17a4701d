"""What was measured and where it came from: the record, its file, and every foreign format."""
