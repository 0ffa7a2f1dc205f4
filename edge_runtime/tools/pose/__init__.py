"""edge-pose: tells robots where they are, from a motion-capture system or a recording."""
