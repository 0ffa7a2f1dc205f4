"""What robots of a task work out for themselves; robots run it, so that PyTorch is not needed."""
