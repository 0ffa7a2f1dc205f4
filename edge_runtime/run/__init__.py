"""edge-run: one robot's process."""
