"""The log of a run: written by a process of its own, and read back."""
