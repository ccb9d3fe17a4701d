"""Tables in text form: lines, cells, how they are written, and their numbers."""
