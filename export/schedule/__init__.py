"""Training many policies: which, at what cost, on which machines."""
