"""edge-ctl: orders from the operator to the whole team."""
