"""The command line: each command reads its options, calls one workflow, prints the result."""
