"""Whole teams in the loop: what must be seen, and how it grows."""
