"""One training run: roll-outs, updates, checkpoints, validation."""
