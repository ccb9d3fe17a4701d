"""One self-contained page that says what was done and whether to trust it."""
