"""Training scenarios and what their policies observe, act on and are scored by."""
