"""Model selection: choices by what is left out, and what left-out errors say of a result."""
