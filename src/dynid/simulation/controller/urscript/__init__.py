"""URScript: from text to a program that runs one control cycle at a time."""
