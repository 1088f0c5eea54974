"""What to solve, what is left out, and why."""
