"""Methods side by side, on arms whose truth is known."""
